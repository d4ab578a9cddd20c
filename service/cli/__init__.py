"""The `hof` command."""

import sys

try:
    from service.server.memory import importing

    with importing():
        from service.cli.main import main
except KeyboardInterrupt:  # Ctrl-C while the command's modules are imported
    sys.exit(130)

__all__ = ["main"]
