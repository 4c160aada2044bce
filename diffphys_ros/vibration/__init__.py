"""What tracks say before any stiffness is known: coordinates (a few motions over time), forced_frames (and the free motion's
frequencies), rest (the shape about which it swings), continuity (gaps, a frame 0 that moves). numpy only."""
