"""Many bags of many vehicles: one calibrate_bag each, on Snakemake, and how each vehicle's extrinsic moved over time."""
