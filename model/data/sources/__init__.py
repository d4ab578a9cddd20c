"""Sources of meshes and photographs."""
