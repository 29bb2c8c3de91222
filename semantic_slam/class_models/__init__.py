"""Kinds of class models (values of ``semantic_model.kind``) and their loaders."""
