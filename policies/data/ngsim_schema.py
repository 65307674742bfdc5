"""The one table that every recording becomes: metres, seconds, relative to the road, unphysical rows flagged.

One row is one vehicle in one frame. Null means that the source does not say.

| column | type | unit | meaning |
| --- | --- | --- | --- |
| source | text | | layout of the file it came from (LAYOUTS) |
| recording | text | | rows of one recording share a clock and vehicle numbers; never compare across recordings |
| vehicle_id | int | | as in the source |
| frame | int | 0.1 s | as in the source; counted from the recording's (or event's) start where it has none |
| time_s | float | s | 0.1 frame |
| epoch_s | float | s | since 1970-01-01 UTC |
| x_m | float | m | the vehicle's centre along the road; null where its length is unknown |
| x_front_m, x_rear_m | float | m | its front and rear bumper; the three are converted where the length is known |
| y_m | float | m | its centre across the road, positive to the left, from the site's own reference line |
| lane | int | | 1 = leftmost |
| lane_offset_m | float | m | y from the lane's centre, positive to the left (or from its median y) |
| heading_rad | float | rad | relative to the road, positive to the left |
| speed_mps | float | m/s | |
| accel_mps2 | float | m/s^2 | |
| length_m, width_m | float | m | |
| vehicle_class | text | | motorcycle, car or truck |
| preceding_id, following_id | int | | ahead and behind in the lane; derived in complete scenes |
| space_headway_m | float | m | to the vehicle ahead, front to front (rear to rear where only rears are recorded) |
| gap_m | float | m | to the vehicle ahead, its rear bumper to this one's front bumper |
| time_headway_s | float | s | space headway / speed |
| flags | int | | sum of the bits in FLAGS: why the row is not to be trusted; 0 = nothing found |
"""

import polars as pl

from policies.data.scenes import DataError

METRES_PER_FOOT = 0.3048
DT_S = 0.1

SCHEMA = {
    "source": pl.String,
    "recording": pl.String,
    "vehicle_id": pl.Int64,
    "frame": pl.Int64,
    "time_s": pl.Float64,
    "epoch_s": pl.Float64,
    "x_m": pl.Float64,
    "x_front_m": pl.Float64,
    "x_rear_m": pl.Float64,
    "y_m": pl.Float64,
    "lane": pl.Int64,
    "lane_offset_m": pl.Float64,
    "heading_rad": pl.Float64,
    "speed_mps": pl.Float64,
    "accel_mps2": pl.Float64,
    "length_m": pl.Float64,
    "width_m": pl.Float64,
    "vehicle_class": pl.String,
    "preceding_id": pl.Int64,
    "following_id": pl.Int64,
    "space_headway_m": pl.Float64,
    "gap_m": pl.Float64,
    "time_headway_s": pl.Float64,
    "flags": pl.Int64,
}

# What a source's position is, before conversion, and what it can teach.
LAYOUTS = {
    "ngsim-text": "official NGSIM trajectory file, 18 columns, feet; position = front bumper",
    "ngsim-csv": "NGSIM portal export, feet; position = front bumper",
    "coifman": "Coifman and Li 2017, 84 m of I-80, feet; position = REAR bumper; no length, no lateral position",
    "perl": "chains of followers, metres; position = front bumper; no length; no lateral position",
    "durraniu": "followers of pairs, reconstructed, metres; position = front bumper",
    "jiang": "pairs, feet; position = front bumper; no length, no lateral position, no numbers",
    "zhu": "car-following events, metres; no position: gap and speeds only",
    "smarts": "single vehicles, metres; position = centre; moved in time, so gaps between them mean nothing",
    "vineet": "followers of pairs, portal columns in metres; position = front bumper",
    "i80-scene": "complete scene, metres; position = front bumper; estimated length, no width",
    "us101-scene": "complete scenes, metres; position = centre",
    "dlr-highway": "DLR Highway Traffic (A39), UTM metres at 20 Hz; position = centre; lanes told from the tracks",
    "exid": "exiD, metres at 25 Hz; position = centre; lanes told from the tracks, none on ramps",
    "highd": "highD, metres at 25 Hz; position = centre of the box; lanes by the recording's lines",
    "i24-motion": "I-24 MOTION, feet at 25 Hz; position = rear bumper; lanes of 12 feet from the yellow line",
}

# name -> (bit, meaning)
FLAGS = {
    "duplicate_frame": (1, "the vehicle has more than one row in this frame"),
    "frame_gap": (2, "frames are missing between the vehicle's previous row and this one"),
    "backward_step": (4, "more than 0.05 m further back than in the previous frame"),
    "jump": (8, "more than 7 m a frame (70 m/s) from the vehicle's previous position"),
    "speed_limit": (16, "speed below 0, or above 45 m/s (70 m/s in layouts of motorways)"),
    "accel_limit": (32, "acceleration beyond [-9, 5] m/s^2"),
    "accel_clipped": (64, "acceleration at NGSIM's clip of 11.2 ft/s^2 = 3.41 m/s^2, either sign"),
    "overlap": (128, "front bumper beyond the rear bumper of the vehicle ahead (gap below 0)"),
    "bad_lane": (256, "lane code outside 1 to 8"),
    "bad_size": (512, "length outside 0.8 to 30 m or width outside 0.3 to 3.5 m"),
    "clock": (1024, "frame number and clock time disagree by more than 0.05 s"),
    "interpolated": (2048, "the source filled the row in between rows that it saw"),
}


class FormatError(DataError):
    """A file that is not what its layout says: names the file, the line, the column, what was found and expected."""

    def __init__(self, path: object, found: str, expected: str, line: int | None = None, column: str = ""):
        self.path, self.line, self.column, self.found, self.expected = path, line, column, found, expected
        where = f"{path}" + (f", line {line}" if line else "") + (f", column {column}" if column else "")
        super().__init__(f"{where}: found {found}, expected {expected}")


def names_of(flags: int) -> list[str]:
    """The names of the bits that are set."""
    return [name for name, (bit, _) in FLAGS.items() if flags & bit]
