"""Whole stores: copies between databases, and Parquet files."""
