"""Results of engines and stationary methods: printed, written, drawn and read back."""
