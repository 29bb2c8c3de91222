"""Why does a map believe this? The evidence behind one object, inferred again from what a belief bag records."""
