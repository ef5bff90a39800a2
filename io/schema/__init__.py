"""What a scene may say: keys, units, bounds, and errors in words."""
