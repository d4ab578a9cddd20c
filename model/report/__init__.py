"""Markdown and pictures: RESULTS.md, model cards."""
