"""Many photos at a time: `hof encode-many`."""
