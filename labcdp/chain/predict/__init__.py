"""What is behind the chain, without random numbers: distributions of DN, CDP and its relatives."""
