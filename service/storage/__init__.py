"""Stored objects: the database, its migrations, ids."""
