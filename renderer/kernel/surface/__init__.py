"""Surface interaction: from a hit to a point with normals, a shading frame, texture coordinates and ray origins."""
