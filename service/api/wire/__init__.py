"""HTTP without routes: bodies, disconnects, caching, content negotiation."""
