"""The paper's experiments, one module each, and the pages that put its numbers beside ours."""
