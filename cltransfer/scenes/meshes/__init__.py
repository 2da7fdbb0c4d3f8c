"""Mesh files: glTF, OBJ and PLY with their materials, skins and textures, each read within limits."""
