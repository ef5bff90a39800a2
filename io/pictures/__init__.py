"""Pictures, movies and the report page of a result file."""
