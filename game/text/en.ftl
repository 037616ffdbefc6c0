# The texts of Carom's user interface, in the syntax of Project Fluent (https://projectfluent.org/fluent/guide/).
#
# A translation is a copy of this file with the right-hand sides translated. Identifiers and { $arguments } stay.

## Menu

menu-quit = Quit
menu-settings = Settings

## Balls

# $number: the number on the ball.
ball-numbered = the { $number }

## Gamepads

# $name: what the gamepad calls itself.
gamepad-connected = Gamepad connected: { $name }
# ---- statistics ----

## Statistics

# Headings of the panels' sections.
stats-section-gantt = Frame by node
stats-section-frames = Frames over time
stats-section-prediction = Predicted against actual
stats-section-redraws = Redraws over time
stats-section-algorithms = Balancing algorithms
stats-section-quality = Quality

# $pictures: how many, a whole number in decimal digits.
stats-pictures-per-second = { $pictures } a second
stats-made-by-nobody = nobody yet
# $count: two or more.
stats-made-by-machines = { $count } machines
# $others: how many more machines do not help. $why: the machine's state and its reason.
stats-absent =
    { $others ->
        [0] { $name } does not help: { $why }
        [one] { $name } does not help: { $why }. Nor does one other machine
       *[other] { $name } does not help: { $why }. Nor do { $others } other machines
    }

# States of a node, in the table of nodes.
stats-state-starting = starting
stats-state-listening = listening
stats-state-paired = paired
# $percent: how much of the scene the node has been sent.
stats-state-syncing = syncing { $percent } %
stats-state-ready = ready
stats-state-rendering = rendering
stats-state-draining = draining
stats-state-lost = lost
stats-state-lost-why = lost ({ $why })
stats-state-lost-retried = lost ({ $why }, tried again within { $seconds } s)
# $state: one of those above. $doubt: what is odd about the node's results.
stats-state-doubted = { $state }; { $doubt }

# The node whose tiles arrived last.
stats-straggler = node { $node }
stats-diagnosis-no-frame = No frame has arrived yet
stats-diagnosis-no-tile = No tile has arrived yet
# $time: stats-diagnosis-time.
stats-diagnosis-alone = Node { $node } ({ $name }) traces alone: { $time }
stats-diagnosis-straggler = Node { $node } ({ $name }) is the straggler: { $time }
# $unused: how many nodes are not used.
stats-diagnosis-balanced =
    { $unused ->
        [0] Balanced: all nodes finish nearly together
        [one] Balanced: all nodes finish nearly together; one node is not used
       *[other] Balanced: all nodes finish nearly together; { $unused } nodes are not used
    }
# $part: milliseconds of the stage in which most of the time went. $whole: those of all stages.
stats-diagnosis-time =
    { $stage ->
        [request] { $part } of its { $whole } ms: waiting to be requested
        [network] { $part } of its { $whole } ms: network
        [queue] { $part } of its { $whole } ms: queueing for its device
        [trace] { $part } of its { $whole } ms: tracing
        [encode] { $part } of its { $whole } ms: encoding
       *[decode] { $part } of its { $whole } ms: decoding here
    }

stats-map = Map
stats-map-about = The map drawn over each tile of the inspected frame.
stats-map-none = none
stats-map-none-about = No map.
stats-map-owner = owner
stats-map-owner-about = A colour and a number for each node: the node that delivered each tile first.
stats-map-cost = cost
stats-map-cost-about = Learned cost of each tile: dark blue is a quarter of the mean or less, green the mean, yellow four times the mean or more.
# The colours of the costs lie between the two.
stats-map-lowest = 1/4
stats-map-highest = 4 times the mean
# $name: of the node, or stats-map-nobody. $times: a decimal number.
stats-map-tile = tile { $tile }: node { $node } ({ $name }), { $times } times the mean cost
stats-map-nobody = nobody

stats-balancer = balancer
stats-balancer-about = The balancing algorithm from the next frame on. The charts mark the change.
stats-hedged = hedged
stats-hedged-about = Hedging: late tiles are requested from other nodes too, and the first result wins. Repeats under 2 % of the work; without it a frame waits for its slowest node.
stats-by-samples = by samples
stats-by-samples-about = While nothing moves, each node traces other samples of the whole frame instead of its own tiles. A lost node then costs noise instead of tiles; the frame crosses the network once for each node.
stats-algorithm-equal = The same number of tiles for each node.
stats-algorithm-naive = In proportion to each node's last speed (tiles per response time).
stats-algorithm-naive-mean = In proportion to the mean of each node's speeds so far.
stats-algorithm-naive-frozen = In proportion to the mean of each node's first 60 speeds, fixed from then on.
stats-algorithm-ab = y = A + B·x with averages over the whole run, after 60 frames in equal parts.
stats-algorithm-ab-exponential = y = A + B·x with moving averages.
stats-algorithm-cycles = Each share moves by a fraction of its distance from the mean time until all times are within 2 %.
stats-algorithm-pull = Work stealing: nodes hold as few tiles as the round trip needs and get more as they deliver.
stats-algorithm-water-filling = y = A + B·w with filtered A and B and the cost of each tile: the earliest common finish.

stats-freeze = Freeze
stats-freeze-about = Freeze the charts at the newest frame. Click a chart to choose another frame.
stats-previous-about = Previous frame.
stats-next-about = Next frame.
stats-resume = Go on
stats-resume-about = Resume live charts.
stats-frozen = Frozen at frame { $frame }

stats-recording-frames = { $written } written, { $missed } left out
stats-recording-place = to { $place }
# $file: a path that ends in .csv; the other file differs in its ending.
stats-recording-files = { $file } and .jsonl
stats-recording-stopped = Recording stopped: { $why }
stats-recording-no-file = cannot create a file in { $folder }: { $why }
stats-recording-full = there are { $count } recordings in it already

stats-quality-smooth = smooth
stats-quality-smooth-about = 60 frames per second, at 426x240 pixels or more.
stats-quality-balanced = balanced
stats-quality-balanced-about = 60 frames per second at sufficient resolution, else 30: twice the samples.
stats-quality-fine = fine
stats-quality-fine-about = 15 frames per second: four times the samples, a seventh of the squared error.

# All times are milliseconds. $balancing: the name of the algorithm.
stats-chart-frame = frame { $frame } by { $balancing }: { $makespan } ms, ideal { $ideal } ms, responses { $mean } ± { $deviation } ms. Click to freeze
stats-sparkline-about = Makespans of the last 60 frames; the top of the chart is the longest.
stats-prediction-none = no prediction yet
# The axes: $low and $high are the ends of both, in milliseconds.
stats-prediction-predicted = predicted, { $low } to { $high } ms
stats-prediction-actual = actual
stats-prediction-node = node { $node }: predicted { $predicted } ms, actual { $actual } ms

stats-gantt-gone = The timeline of this frame is no longer stored.
stats-gantt-ideal = ideal { $milliseconds }
# A bar under the pointer, in three lines. $twice: how many of the tiles another node had delivered before.
stats-gantt-tiles =
    { $twice ->
        [0] node { $node }, tiles { $from } to { $to }
       *[other] node { $node }, tiles { $from } to { $to }, { $twice } of them duplicates
    }
stats-gantt-times = requested at { $requested } ms, received at { $received } ms
stats-gantt-times-predicted = requested at { $requested } ms, received at { $received } ms, predicted for { $predicted } ms
stats-gantt-stages = busy { $busy }, network { $network }, queue { $queue }, encode { $encode }, decode { $decode } ms

## Glossary of the statistics

# Names of figures, each before its number, and what they mean, shown under the pointer.
glossary-fps = fps
glossary-fps-about = Redraws of the window per second, over the last quarter of a second in which something moved. Traced frames are counted by frames/s.
glossary-new-pictures = new pictures
glossary-new-pictures-about = Pictures per second that are traced. Between them the newest one is moved to where you look, so that fps may be higher.
glossary-delay = each takes
glossary-delay-about = Milliseconds from the request of a picture until it is there. Shots are requested that much ahead, so that you do not wait.
glossary-sharpness = sharpness
glossary-sharpness-about = Edge of the newest picture as a share of the window's. A view that rests gets to the resolution of the settings, 100 % unless you chose less.
glossary-made-by = made by
glossary-made-by-about = Device that traces the picture, or how many machines do.
glossary-fps-mean = mean
glossary-fps-mean-about = Mean redraws per second over the last 1,000 while something moved.
glossary-low-1 = 1% low
glossary-low-1-about = Redraw rate of the slowest 1 %: one over the 99th percentile of the time between redraws, over the last 1,000.
glossary-low-01 = 0.1% low
glossary-low-01-about = Redraw rate of the slowest 0.1 %, over the last 1,000 redraws.
glossary-pictures = frames/s
glossary-pictures-about = Traced frames per second that arrived from the farm, over the last 600.
glossary-makespan = frame
glossary-makespan-about = Makespan: milliseconds from the request of the frame until its last tile arrived.
glossary-ideal = ideal
glossary-ideal-about = Milliseconds that the same nodes would have needed with a division that lets all finish together, from their own starts and reported speeds.
glossary-efficiency = balance
glossary-efficiency-about = Balance efficiency: ideal over actual makespan in per cent. At 100 no other division would have been faster.
glossary-idle = idle
glossary-idle-about = Mean share of the makespan in which the participating nodes had no work left.
glossary-straggler = last
glossary-straggler-about = Straggler: the node whose tiles arrived last.
glossary-nodes = nodes
glossary-nodes-about = Nodes that hold the scene and can trace, of all configured nodes.
glossary-mbit = Mbit/s
glossary-mbit-about = Megabits of pixels per second from the farm, over the last 600 frames.
glossary-ratio = packed
glossary-ratio-about = Compression ratio: bytes of the pixels before encoding over bytes on the link.
glossary-late = late
glossary-late-about = Tiles requested from a second node because they would have been late, over the last 600 frames.
glossary-lost = lost
glossary-lost-about = Tiles requested again because their node was lost, refused them or timed out, over the last 600 frames.
glossary-reissued = reissued
glossary-reissued-about = All tiles requested again, late and lost, over the last 600 frames.
glossary-twice = twice
glossary-twice-about = Duplicate tiles, of which the first was kept, over the last 600 frames.
glossary-dropped = dropped
glossary-dropped-about = Samples that were NaN or infinite and count as black, over the last 600 frames.
glossary-size = size
glossary-size-about = Resolution of the traced frame, which is scaled to the window, and samples per pixel.
glossary-lead = lead
glossary-lead-about = Time by which frames of a shot are requested ahead: the 95th percentile of the frame latency.
glossary-skipped = skipped
glossary-skipped-about = Frames of shots that were skipped because a later one was due already, since the start of the program.
glossary-revealed = revealed
glossary-revealed-about = Disocclusion: share of the window that the newest traced frame did not show before reprojection to the present camera and balls.
glossary-shown-by = shown by
glossary-shown-by-about = Presentation back end of the window.

# The stages of a frame, in the order in which a tile goes through them.
glossary-request = request
glossary-request-about = Critical path, 1 of 6: milliseconds from the request of the frame until the node of the last tile was sent its request.
glossary-network = network
glossary-network-about = Critical path, 2 of 6: milliseconds in the network, both directions, queues included.
glossary-queue = queue
glossary-queue-about = Critical path, 3 of 6: milliseconds in the queue of the node's device, by the node's clock.
glossary-trace = trace
glossary-trace-about = Critical path, 4 of 6: milliseconds of tracing, by the node's clock.
glossary-encode = encode
glossary-encode-about = Critical path, 5 of 6: milliseconds of encoding, by the node's clock.
glossary-decode = decode
glossary-decode-about = Critical path, 6 of 6: milliseconds of decoding, by this machine's clock.

glossary-draw = draw
glossary-draw-about = Milliseconds of the last redraw on this machine: reprojection, interface and presentation.
glossary-redraws = redraw
glossary-redraws-about = Milliseconds between redraws of the window while something moves, the last 240. The line is the frame budget.

# Columns of the table of nodes, narrow: most labels have room for five letters and are cut there.
glossary-node = node
glossary-node-about = Number and name of the node, as in the map and the Gantt chart.
glossary-state = state
glossary-state-about = Connection state of the node: starting, paired (no scene yet), syncing (share of the scene received), ready, or lost.
glossary-device = device
glossary-device-about = Devices that the node traces with.
glossary-tiles = tiles
glossary-tiles-about = Tiles of this frame delivered by the node.
glossary-share = share
glossary-share-about = The node's share of this frame's work, per cent.
glossary-response = resp
glossary-response-about = Response time: milliseconds from the request of this frame until the node's last tile arrived.
glossary-response-mean = mean
glossary-response-mean-about = Mean response time of the node over those of the last 600 frames it took part in, milliseconds.
glossary-response-sigma = σ
glossary-response-sigma-about = Standard deviation of the node's response times, milliseconds.
glossary-response-p99 = p99
glossary-response-p99-about = 99th percentile of the node's response times, milliseconds.
glossary-response-max = max
glossary-response-max-about = Maximum of the node's response times, milliseconds.
glossary-node-network = net
glossary-node-network-about = Network time of the node's last tile of this frame, both directions, milliseconds.
glossary-node-queue = queue
glossary-node-queue-about = Queueing time of the same tile at the device, milliseconds.
glossary-node-trace = trace
glossary-node-trace-about = Tracing time of the same tile, milliseconds.
glossary-node-codec = codec
glossary-node-codec-about = Encoding and decoding time of the same tile, milliseconds.
glossary-fixed = A ms
glossary-fixed-about = A of the cost model y = A + B·x: the learned fixed cost of a request in milliseconds, with its standard error.
glossary-pace = B ms/M
glossary-pace-about = B of the cost model y = A + B·x: learned milliseconds per million samples of mean cost, with its standard error.
glossary-predicted = pred
glossary-predicted-about = Predicted response time of the node when the tile was requested, milliseconds.
glossary-error = err%
glossary-error-about = Prediction error: actual over predicted response time, less one, per cent; above 0 the node was slower.
glossary-node-bytes = kB
glossary-node-bytes-about = Kilobytes of the node's pixels of this frame on the link.
glossary-node-ratio = packed
glossary-node-ratio-about = Compression ratio of the node's tiles.
glossary-node-late = late
glossary-node-late-about = Tiles of the node that arrived more than a tenth and 1 ms after their prediction, over the last 600 frames.
glossary-node-lost = lost
glossary-node-lost-about = Tiles that the node refused, lost with its connection or let time out, since the start of the program.
glossary-node-twice = twice
glossary-node-twice-about = Tiles of the node that another node had delivered before, over the last 600 frames.

# What each balancing algorithm has reached.
glossary-tally-frames = frames
glossary-tally-frames-about = Frames divided by this algorithm since the start of the program.
glossary-tally-efficiency = balance
glossary-tally-efficiency-about = Mean balance efficiency of those frames, per cent.
glossary-tally-sigma = σ
glossary-tally-sigma-about = Mean over those frames of the standard deviation of the nodes' response times, milliseconds.
glossary-tally-max = max
glossary-tally-max-about = Mean over those frames of the longest response time, milliseconds.
glossary-recording = recording
glossary-recording-about = Frames written to the files of the recording. Frames that the disk was too slow for are left out and counted.

# The quality levels.
glossary-level-scale = pixels
glossary-level-scale-about = Resolution of a traced frame at this quality level.
glossary-level-samples = spp
glossary-level-samples-about = Samples per pixel at this quality level; + where frames are denoised.
glossary-level-ms = ms here
glossary-level-ms-about = Predicted milliseconds of a frame at this quality level on this farm.
