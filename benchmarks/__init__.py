"""Measurements of the service: speed/ for `make bench`, load/ for `make load` and `make soak`."""
