"""Objects that Infinigen makes, in a process and an environment of its own."""
