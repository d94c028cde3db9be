"""The Taichi runtime: start, device arrays, kernel launches, graphics cards."""
