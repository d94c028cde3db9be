"""Slices as they are read: of one component, of a moving nest, kept and read ahead."""
