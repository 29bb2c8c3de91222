"""Pages that are written from the code and from kept results, so that no number in them is typed by hand."""
