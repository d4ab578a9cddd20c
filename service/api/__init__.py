"""The HTTP API: the application, its routes and middleware, and its problems."""
