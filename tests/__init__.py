"""Tests: a folder mirrors each of service/ and model/; helpers are in support/."""
