"""Trainings on views in front of backgrounds that each step makes: of the matte network, and by distillation."""
