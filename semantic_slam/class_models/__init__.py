"""What a value of ``semantic_model.kind`` stands for, and what loads the models."""
