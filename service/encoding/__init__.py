"""The steps from the bytes of a photo to theta: decoding, matting, framing, inference."""
