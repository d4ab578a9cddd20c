"""Methods that the model is compared with, and what they need."""
