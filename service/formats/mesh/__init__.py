"""Surfaces as files, one module per format."""
