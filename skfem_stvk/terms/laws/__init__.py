"""Laws: materials on elements, networks of edges, and energies of the volume."""
