"""What engines hand over, and its streaming accumulation."""
