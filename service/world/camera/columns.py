"""The arrays that the camera's kernels pass on, column by column: one array costs a call less than many."""

# The camera and the light, (CAMERA,) float64. Picture lengths are in samples; radiances are linear
# RGB in steps of the tone table.
EYE = 0  # 3: where it is, m
RIGHT, DOWN, FORWARD = 3, 6, 9  # 3 each: its axes; RIGHT is level
FOCAL, CENTRE_X, CENTRE_Y, WIDTH, HEIGHT, HORIZON = 12, 13, 14, 15, 16, 17
TO_SUN, SUN, SKY_UP, SKY_SIDE, GROUND_LIGHT = 18, 21, 24, 27, 30  # 3 each; irradiances
FOG, SHEEN = 33, 36  # 3 each: radiance of the air, and what a wet or grazing road mirrors
LAMPS, RANGE_M, SIGNAL, WET, HEADLIGHT, RANGE_STEP_M = 39, 40, 41, 42, 43, 44
SHADE, CONTACT = 45, 48  # 3 each: share of the signal left in the sun's shadow, and under a vehicle
LIGHTS_ON = 51
ZENITH, SKY_HORIZON, HALO, CLOUD, COVER = 52, 55, 58, 61, 64
CAMERA = 65

# A polygon to draw, (POLYGON,) float64.
CORNERS = 10  # at most, after clipping
X, Y = 0, CORNERS  # CORNERS each, in samples
COUNT, TOP, BOTTOM = 20, 21, 22  # corners; first row and one past the last
PLANE = 23  # 3: inverse depth is PLANE[0] X + PLANE[1] Y + PLANE[2]
COLOUR = 26  # 3: radiance without headlights; of a shadow the share of the signal that is left
MIRROR = 29  # 3: radiance per unit of headlight
LABEL, KIND = 32, 33
POLYGON = 34
SOLID, GROUND, SHADOW = 0, 1, 2

# A solid face, (FACE,) float64.
NORMAL, ALBEDO, GLOW, SIZE, RETRO, FACE_LABEL = 12, 15, 18, 21, 22, 23  # after four corners of 3
FACE = 24

# A strip on the ground, (STRIP,): four corners of 2, then
STRIP_ALBEDO, STRIP_RETRO, STRIP_LABEL = 8, 11, 12
STRIP = 13

# A painted line, (LINE,): both ends of 2, then
LINE_HALF_M, LINE_SHARE, LINE_ALBEDO, LINE_RETRO = 4, 5, 6, 9
LINE = 10
