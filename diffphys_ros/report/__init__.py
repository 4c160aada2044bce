"""What people look at: the summary figure (figure.py, matplotlib) and the rerun recording (rerun_log.py, rerun)."""
