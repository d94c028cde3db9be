"""Reading of slices: of one component or a moving nest, with caches and read-ahead."""
