"""Two cases with searches: targets that steer, and one that a sonar heard."""

# Two ways that steer and one that drifts, of blocks of its own each; every kind of sensor; contacts
# that are certain, doubtful, doubtful at the same time, of debris, of motion, and at the begin; a
# sortie under way at each; two that share an unknown factor; lines; what is overdue. A contact and
# a sortie's end are within one step.
STEERED = """
start = "2026-03-05T00:20Z"
duration = "20 h"
particles = 5000
seed = 12
output.every = "10 h"
[clock]
step = "50 min"
[coast]
source = "none"
[uncertainty]
diffusivity = "300 m2/s"
current = { std = "0.1 m/s", time = "9 h" }
[resampling]
below = 0
[[current]]
constant = { speed = "0.9 kn", toward = 141 }
[[scenario]]
name = "yacht"
object = "water"
weight = 0.84
overdue = "+17 h"
[[scenario.phase]]
[scenario.phase.voyage]
waypoints = [[179.3, 43.1], [-179.2, 43.9]]
departure = ["+1 h", "+6 h"]
speed = { low = "5 kn", best = "7 kn", high = "11 kn", ratio = 4 }
cross_track = "3 nmi"
[scenario.distress]
between = ["+4 h", "+41 h"]
[[scenario]]
name = "tender"
weight = 0.06
object = "water"
position = { at = [179.6, 43.3], std = "9 nmi", time = "+0 h", until = "+6 h" }
[[scenario]]
name = "bridge"
weight = 0.1
[[scenario.phase]]
[scenario.phase.bridge]
k = "5 nmi/sqrt(h)"
k_spread = 1.6
[[scenario.phase.bridge.points]]
at = [179.3, 43.1]
std = "5 nmi"
time = ["+0 h", "+2 h"]
[[scenario.phase.bridge.destinations]]
at = [-179.4, 44.1]
std = "6 nmi"
time = ["+18 h", "+21 h"]
probability = 1
[[sortie]]
name = "drifting"
unit = "Helicopter"
start = "+3 h"
speed = "60 kn"
sweep_width = "1900 m"
sweep_width_uncertainty = "30 %"
pattern = { kind = "parallel", centre = [179.7, 43.3], length = "40 km", width = "12 km", orientation = 30, spacing = "2500 m" }
frame = "datum"
[[sortie]]
name = "again"
unit = "Helicopter"
start = "+11.2 h"
speed = "60 kn"
sweep_width = "1700 m"
sweep_width_uncertainty = "30 %"
pattern = { kind = "parallel", centre = [-179.9, 43.5], length = "40 km", width = "12 km", orientation = 120, spacing = "2500 m" }
[[sortie]]
name = "area"
start = "+6 h"
end = "+14 h"
law = "random"
pod = 0.5
area = { polygon = [[179.5, 43.1], [-179.9, 43.1], [-179.8, 43.6], [179.6, 43.7]] }
[[contact]]
name = "doubtful"
time = "+8 h"
belief = 0.6
position = { at = [179.9, 43.4], std = "15 nmi" }
course = { value = 70, std = "40 deg" }
[[contact]]
name = "as doubtful"
time = "+8 h"
belief = 0.8
bearing = { from = [179.0, 43.0], bearing = 60, std = "15 deg" }
[[contact]]
name = "certain"
time = "+12.1 h"
position = { at = [-179.95, 43.5], std = "25 nmi" }
[[contact]]
name = "debris"
time = "+15 h"
belief = 0.5
of = "PIW-4"
position = { at = [179.95, 43.4], std = "25 nmi" }
[[look]]
name = "dip"
time = "+4.4 h"
at = [179.7, 43.3]
width = "17 nmi"
height = "13 nmi"
turned = 25
sees = "nothing"
[[presence]]
name = "buoys"
start = "+3 h"
end = "+9.3 h"
at = [179.8, 43.5]
radius = "9 nmi"
present = "never"
detection = 0.7
[[barrier]]
name = "picket"
points = [[179.9, 43.8], [179.97, 43.3], [179.95, 43.0]]
start = "+1 h"
end = "+14 h"
detection = 0.6
reported = "+9.4 h"
error = "90 min"
false_alarms = "0.02/h"
[[line]]
name = "sound"
points = [[-179.9, 43.9], [-179.8, 43.1]]
"""
# Contacts of a sonar whose unknown they share with a look of it and a watch, of one source, and
# doubtful ones at once with others.
HEARD = """
[[sensor]]
name = "array"
at = [179.7, 43.2]
heading = 20
[sensor.sonar]
source_level = [["5 kn", "133 dB"], ["11 kn", "141 dB"]]
noise = "71 dB"
gain = { line = { elements = 16, spacing = "15 m", frequency = "50 Hz" } }
fluctuation = "5 dB"
unknown = "3 dB"
[[contact]]
name = "first"
time = "+6.4 h"
bearing = { sensor = "array", bearing = 60, wedge = "80 deg" }
received_level = { value = "60 dB", std = "4 dB" }
frequency = { value = "50.1 Hz", std = "0.1 Hz", source = "50 Hz", source_std = "0.1 Hz", source_group = "shaft" }
[[contact]]
name = "heard, in doubt"
time = "+8 h"
belief = 0.7
bearing = { sensor = "array", bearing = 70, std = [[0, "30 deg"], [90, "12 deg"]] }
[[contact]]
name = "last"
time = "+9.1 h"
range = { sensor = "array", range = "20 nmi", std = "10 nmi" }
frequency = { value = "49.95 Hz", std = "0.1 Hz", source = "50 Hz", source_std = "0.1 Hz", source_group = "shaft" }
[[look]]
name = "listened"
time = "+7 h"
sensor = "array"
sees = "nothing"
[[sortie]]
name = "listens"
start = "+6 h"
end = "+6.5 h"
watch = { sensor = "array", beams = [1, 2, 3] }
"""
