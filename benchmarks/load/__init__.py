"""The service under load: batching, overload, peers, kills, damaged images, and the soak."""
