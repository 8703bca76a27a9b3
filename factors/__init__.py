"""Everything that knows GTSAM: the factors of the joint adjustment."""
