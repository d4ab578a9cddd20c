"""ShapeNet in the layouts in which others published it, converted into a data set of this project."""
