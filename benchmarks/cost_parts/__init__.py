"""Parts of benchmarks/costs.py: each measures one kind of cost and gives numbers for docs/scale.json."""
