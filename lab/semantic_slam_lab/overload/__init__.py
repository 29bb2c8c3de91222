"""Live nodes that are sent more than they can use."""
