"""The tables and figures of the paper, from recoveries of clips: `make paper` (docs/paper.md). A development tool, never installed."""
