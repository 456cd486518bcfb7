"""How long the parts of a tick take, beside other libraries."""
