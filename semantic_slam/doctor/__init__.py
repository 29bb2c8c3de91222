"""What keeps a recording, or a running system, from giving a right map, each fault with its remedy."""
