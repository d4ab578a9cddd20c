"""Trainings on views before backgrounds that each step makes: of the matte network, and by distillation."""
