"""Worker processes that carry out calls, and pools of them."""
