"""The estimates of an encoder, confidence and camera, observed and measured."""
