"""Parts of the study of column collapse: its cases, what is measured, and the pictures."""
