"""The HTTP server: uvicorn in one process or several, and a stop that loses no call."""
