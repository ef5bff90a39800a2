"""Result files and checkpoints: writing, reading, comparing."""
