"""Meshes and photographs from outside."""
