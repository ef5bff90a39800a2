"""Water in the pores."""
