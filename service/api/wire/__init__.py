"""HTTP below the routes: bodies, disconnects, caching, content negotiation."""
