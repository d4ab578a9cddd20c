"""Helpers of the tests and the benchmarks: servers, processes, databases, photos, small inputs."""
