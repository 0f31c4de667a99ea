"""interslice in napari."""
