"""The `hof-model` command."""

from model.cli.main import main

__all__ = ["main"]
