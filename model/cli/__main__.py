"""`python -m model.cli` is `hof-model`."""

import sys

from model.cli import main

sys.exit(main())
