"""Speed of computing and serving points, beside other ways to compute them and the paper's decoders."""
