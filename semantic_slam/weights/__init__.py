"""Files that ship with the package: the trained network and the viewpoint models fitted with it."""
