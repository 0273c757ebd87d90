"""Records, which engines hand over in chunks, and their streaming accumulation."""
