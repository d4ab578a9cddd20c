"""The calls of the API: HTTP only. They parse, call, and respond."""
