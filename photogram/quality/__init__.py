"""What covariances, residuals and check points say about an adjusted block.

Changes no estimate, but for `gross_errors`, which adjusts again without what it rejects.
`accuracy`, `asprs`, `diagnosis.diagnose`, `cloud_comparison.compare_to_reference`.
"""
