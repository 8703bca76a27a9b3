"""What several benchmarks share: true surfaces, scores of dense heights, the peer of dense matching, paths of data."""
