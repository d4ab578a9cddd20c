"""Inputs that objects are encoded from: photos, several views of one object, points and meshes."""
