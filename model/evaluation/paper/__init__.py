"""Experiments of the paper on our data, one module each; `record` is what they write."""
