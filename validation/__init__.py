"""Is the package right? Checks that take longer than tests, and the meshes for them."""
