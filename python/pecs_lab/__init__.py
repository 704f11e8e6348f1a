"""What benches, tools and studies share: scenes with a known truth, recordings drawn from them. Not in the wheel."""
