"""Routes of the API: they parse requests, call the runtime, and answer. HTTP only."""
