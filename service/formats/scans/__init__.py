"""Reading of a user's points and meshes: PLY, PCD, NPY, XYZ; GLB, OBJ, STL. Bounded, and without another library."""
