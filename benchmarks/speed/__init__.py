"""Points computed and served: how fast, beside other ways and the decoders of the paper."""
