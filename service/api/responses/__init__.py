"""JSON of answers, and their OpenAPI descriptions."""
