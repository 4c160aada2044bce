"""What a recovery by an object's outline rests on beside its points."""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Swing:
    """How the body, let go as the first frames show it, with the modulus of the calm frames and no force but its weight, swings against the picture.
    Two numbers are read from that swing itself: how the modulus gives way, and the drag of squared speed."""

    frames: int  # that are compared
    tip_motion_px: float  # of the free end, root mean square about its mean
    tip_error_px: float  # root mean square
    tip_error_share: float  # of the motion
    constant_error_share: float  # the same where nothing is read from this swing: modulus and drag stay those of the calm frames
    softens: float  # share by which the modulus falls, over the strain
    drag_per_m: float  # of the air, over mass and squared speed
    softening: float  # frequency of the calm frames over that of a small swing: Young's modulus is found too small by about its square
    first: int = 0  # of the recording's frames, in which it is let go


@dataclass(frozen=True)
class Hanging:
    """Where in its picture an object hangs, at what scale, and which of the recording's frames its small motions are read from."""

    rest_frame: int  # of the recording; frame 0 of the fitted clip
    end_frame: int  # one after the last that is fitted
    frames: int  # of the recording
    periods: float  # of the swing that are fitted
    behind_px: float  # how far the held face lies behind the clamp's line
    behind_px_sd: float
    px_per_m: float  # of the object in the picture
    px_per_m_sd: float
    length_told: bool  # whether the scale is known; false: moduli and forces hold relative to the object's size alone
    log10_young_sd: float  # of what the clamp's place and the depth across the picture leave open
    swing: Swing | None = None  # the large swing before, predicted

    def cut(self, begin: int) -> Hanging:
        """The same of the recording from a frame on."""
        return replace(self, rest_frame=self.rest_frame - begin, end_frame=self.end_frame - begin, frames=self.frames - begin)
