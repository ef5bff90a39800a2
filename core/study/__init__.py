"""Many variants of one scene: which they are, their runs side by side, their table and page."""
