"""Networks: the image encoder, the mapping function in torch, and the decoders they are compared with."""
