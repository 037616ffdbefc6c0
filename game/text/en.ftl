# The texts of Carom's user interface, in the syntax of Project Fluent (https://projectfluent.org/fluent/guide/).
#
# A translation is a copy of this file with the right-hand sides translated. Identifiers and { $arguments } stay.

## Menu

menu-title = Carom
menu-resume = Resume
menu-resume-match = Back to the match
menu-new-game = New game
menu-rack-again = Rack again
menu-replays = Replays
menu-practice-table = Practice table
menu-screenshot = Screenshot
menu-settings = Settings
menu-keys = Keys and mouse
menu-quit = Quit
menu-back = Back
menu-how = Arrows and Enter choose, Esc goes back

# What a newcomer may begin with.
menu-welcome = Welcome to Carom
menu-play = Play 8-ball
menu-watch = Watch
menu-practice = Practice

# After a match; a drill is tried again.
menu-rematch = Rematch
# The best score of a drill so far.
menu-drill-best = Your best: { $score }
menu-try-again = Try again
menu-back-to-table = Back to the table
# Before a new game takes the place of a match that is not over.
menu-give-up = The match is not over
menu-keep-match = Keep playing it
menu-begin-anyway = Give it up and begin

## New game

new-game-rules = Game
new-game-drill = Drill
new-game-against = Against
new-game-person = A person at this machine
new-game-person-about = You take turns with mouse and keys
# $level: easy, medium, hard or expert.
new-game-computer = Computer, { $level }
# A heading over numbers to choose from. $unit: what is counted, as racks or points.
new-game-first-to = { $unit ->
    [racks] Racks to win
    [frames] Frames to win
   *[points] Points to win
}
new-game-begin = Begin

# Names of people who play.
player-you = You
player-1 = Player 1
player-2 = Player 2

# What each game is.
new-game-rules-free = A table without rules: everything is allowed
new-game-rules-eight = 8-ball: a group of seven each, then the 8
new-game-rules-nine = 9-ball: always the lowest first, the 9 wins
new-game-rules-straight = Straight pool, 14.1 continuous: any called ball is a point
new-game-rules-snooker = Snooker: reds and colours in turn, then the colours in order
new-game-rules-three-cushion = Three-cushion carom: three cushions before the second ball
new-game-rules-line-up = Drill: ten balls in a line, a point for each until a miss
new-game-rules-spot-shots = Drill: ten shots at a ball on the foot spot, from behind the head string
new-game-rules-position-play = Drill: three balls in order, five times, with the cue ball in hand at first
new-game-rules-daily-shot = Drill: one layout a day, the same for everybody; three points at the first attempt

# How each level of the computer plays.
new-game-level-easy = Misses most shots that are not straight in
new-game-level-medium = Pots easy shots, and sometimes two in a row
new-game-level-hard = Pots most shots and thinks of the next
new-game-level-expert = Hardly misses

## Settings

settings-restore = Restore the defaults
settings-saved = Saved in { $path }
settings-not-saved = Not saved: this platform has no folder for settings
setting-percent = { $percent } %
# After the number of a slider.
setting-percent-suffix = {" "}%

# Each choice with the sentence that explains it.
setting-aim-aids = Aim aids
setting-aim-aids-off = Off
setting-aim-aids-off-about = Nothing but the cue
setting-aim-aids-line = Line
setting-aim-aids-line-about = The cue ball's path to what it meets first
setting-aim-aids-ghost = Ghost
setting-aim-aids-ghost-about = Ghost ball at contact, and where both balls go next
setting-aim-aids-full = Full
setting-aim-aids-full-about = The paths of all balls until they rest, at the power that is set

setting-ball-marks = Marked balls
setting-ball-marks-legal = Legal
setting-ball-marks-legal-about = Balls that may be hit first are ringed, where not all may
setting-ball-marks-off = Off
setting-ball-marks-off-about = No ball is marked

setting-ball-set = Balls
setting-ball-set-classic = Classic
setting-ball-set-classic-about = Phenolic resin with numbers and stripes
setting-ball-set-glass = Glass
setting-ball-set-glass-about = Glass with numbers: stripes are paler, and each ball throws its colour onto the cloth
setting-ball-set-jade = Jade
setting-ball-set-jade-about = Jade and other translucent stone with numbers: stripes are paler
setting-ball-set-metal = Metal
setting-ball-set-metal-about = Anodised metal in the balls' colours, with numbers: solids polished, stripes brushed

setting-cloth = Cloth
setting-cloth-tournament = Tournament
setting-cloth-tournament-about = The game's own: blue, and green for snooker
setting-cloth-blue = Blue
setting-cloth-blue-about = Tournament blue
setting-cloth-green = Green
setting-cloth-green-about = Green
setting-cloth-red = Red
setting-cloth-red-about = Burgundy
setting-cloth-grey = Grey
setting-cloth-grey-about = Slate grey

setting-cue = Cue
setting-cue-rosewood = Rosewood
setting-cue-rosewood-about = A maple shaft, a butt of dark rosewood
setting-cue-ebony = Ebony
setting-cue-ebony-about = A maple shaft, a butt of ebony
setting-cue-ash = Ash
setting-cue-ash-about = Ash from tip to butt, as snooker cues are
setting-cue-carbon = Carbon
setting-cue-carbon-about = A black carbon shaft, a butt stained blue

setting-pockets = Pockets of the next game
setting-pockets-tight = Tight
setting-pockets-tight-about = 7 % narrower: 4 1/4 inches instead of 4 9/16 in the corners of a 9-foot table
setting-pockets-standard = Standard
setting-pockets-standard-about = As the table's rules have it
setting-pockets-wide = Wide
setting-pockets-wide-about = 10 % wider: 5 inches in the corners of a 9-foot table

setting-particle-precision = Sand, snow, jelly, water
setting-particle-precision-coarse = Coarse
setting-particle-precision-coarse-about = Cells of 15 mm: coarse grains, two thirds of the time a second of the shot
setting-particle-precision-standard = Standard
setting-particle-precision-standard-about = Cells of 12.5 mm
setting-particle-precision-fine = Fine
setting-particle-precision-fine-about = Cells of 10 mm: fine grains, two to three times the time
particle-cost = A shot into the sand trap: { $particles } particles, { $time } s of a core, the cue ball is on average { $differs } mm from where it is at the finest over the first second, and the sand behind it { $surface } mm. The stroke waits for it

setting-particles = Dust
setting-particles-off = Off
setting-particles-off-about = No dust
setting-particles-some = Some
setting-particles-some-about = A quarter of the dust: up to 400 specks of chalk at a stroke
setting-particles-all = All
setting-particles-all-about = All of the dust: up to 1600 specks of chalk at a stroke

setting-table-speed = Table speed of the next game
setting-table-speed-slow = Slow
setting-table-speed-slow-about = Heavy or worn cloth: a ball rolls three quarters as far
setting-table-speed-standard = Standard
setting-table-speed-standard-about = Cloth of tournaments
setting-table-speed-fast = Fast
setting-table-speed-fast-about = New and thin cloth: a ball rolls a third farther

setting-brightness = Brightness
setting-brightness-dim = Dim
setting-brightness-dim-about = Half the light, for dark rooms
setting-brightness-normal = Normal
setting-brightness-normal-about = As the room is lit
setting-brightness-bright = Bright
setting-brightness-bright-about = Half as much light again
setting-brightness-daylight = Daylight
setting-brightness-daylight-about = Twice the light, for displays in daylight

setting-quality = While things move
setting-quality-smooth = Smooth
setting-quality-smooth-about = 60 frames a second where 426x240 pixels allow it
setting-quality-balanced = Balanced
setting-quality-balanced-about = 60 a second where they are fine enough, else 30: twice the samples
setting-quality-fine = Fine
setting-quality-fine-about = 15 a second: four times the samples, a seventh of the error

setting-threads = CPU threads
setting-threads-all = All
setting-threads-count = Threads
# $count: threads that the player has chosen.
setting-threads-about = { $count ->
    [0] One per core, which is fastest. Takes effect at the next start
   *[other] Leaves the other cores to other programs. Takes effect at the next start
}
setting-resolution = Resolution
setting-resolution-half = Half
setting-resolution-half-about = Half of the window's along each edge: a quarter of the work, soft edges
setting-resolution-three-quarters = Three-quarters
setting-resolution-three-quarters-about = Three quarters of the window's along each edge: 56 % of the work
setting-resolution-full = Full
setting-resolution-full-about = A traced pixel for each of the window

setting-farm = Rendered by
# $display: what draws the window, such as Vulkan.
setting-display = Presented through { $display }
setting-window = Window
setting-fullscreen = Fullscreen
setting-text-scale = Text size
setting-motion = Motion
setting-reduced-motion = Reduced motion
setting-reduced-motion-about = The camera cuts instead of gliding; panels do not slide or fade
setting-sound = Sound
setting-volume = Volume
setting-mouse = Mouse
setting-mouse-speed = Speed
setting-invert-pitch = Invert the camera's up and down
setting-keys = Keys
setting-keys-change = Change the controls
setting-physics = Advanced: physics

## Replays

replay-event-before = ◀ Event
replay-event-next = Event ▶
replay-pause = Pause
replay-play = Play
# $moment and $end: seconds since the stroke.
replay-moment = { $moment } / { $end } s
# $secs: seconds since the stroke, $event: what happened then.
replay-happening = { $secs } s: { $event }
replay-no-shot = No shot yet
replay-save-shot = Save this shot
# $count: the number of shots, at least 2.
replay-save-all = Save all { $count }
replay-film = Film it
replay-film-about = Renders this shot, as it is seen, to a video file while the game goes on
replay-cancel-film = Cancel the film ({ $percent } %)
replay-play-from-here = Play from here
replay-play-from-here-about = Restores the balls as they were before this shot
replay-close = Back to the game
# Each argument is the names of the keys.
replay-keys = { $pause } play/pause · { $back } and { $forward } rewind/forward · { $event_before } and { $event_next } previous/next event · { $speeds } speed · { $shot_before } and { $shot_next } previous/next shot · { $close } close

# The list of saved shots and layouts.
files-open = Open
files-none = Nothing saved yet

## Match display

match-thinking = { $player } is thinking …
# $title: the name of the game, $goal: what wins it.
match-game = { $title }, { $goal }
# The score of a drill and the most that it can be.
match-score-of = { $score } of { $most }
# $state: the player's group and the like, may be empty; $balls: numbers of the balls that are left.
match-left = { $state } · left: { $balls }
match-call = Call
match-called = { $call } (called)
match-called-by-aim = { $call } (by your aim)
match-nothing-called = No call yet: aim at a pot or click a pocket, or your turn ends even if a ball drops
match-safety = Safety
match-push-out = Push-out
match-next-call = { $keys }: next
match-undo = Undo
match-redo = Redo
match-suggest = Suggest
# $level: of the computer that plays: easy, medium, hard or expert.
match-take-over = Play it for me, { $level }
match-pick-up = Move the cue ball
match-log = Log

# The power bar and the disc of spin.
cue-speed = { $speed } m/s
# $speed: the text of cue-speed.
cue-power = Power { $percent } %, { $speed }
cue-power-about = Power: the speed of the cue. Click or drag to set it
# $right and $up: percent with their signs.
cue-spin = Spin { $right } % right, { $up } % up
cue-spin-about = Point of contact on the cue ball; outside the ring the tip slips off. Click or drag to set it
cue-raised = cue raised { $degrees }°
cue-slips = the tip slips off

# First lessons; the arguments are names of keys.
lesson-aim = Move the mouse: it turns the cue
lesson-strike = Hold { $stroke }, pull back and let go to strike, or press { $strike }
lesson-suggest = Press { $suggest } for a suggested shot, then { $strike } to strike it

## Practice

practice-how = Drag the balls. Click a number to add or remove its ball
practice-paint = Choose what the cloth is painted with
practice-sand = Sand
practice-snow = Snow
practice-jelly = Jelly
practice-water = Water
practice-marbles = Marbles
practice-sweep = Sweep
practice-tricks = Trick tables
practice-sand-trap = Sand trap
practice-snow-patch = Snow patch
practice-jelly-bumper = Jelly bumper
practice-spilled-drink = Spilled drink
practice-bowl-of-marbles = Bowl of marbles
practice-play = Play
practice-save = Save this layout
practice-discard = Discard changes
practice-esc = Esc discards the changes
practice-cue-ball = Cue ball
# Over a ball in the hand, where it may lie.
practice-free = OK

## Controls

controls-close = Press { $keys } to close
keys-restore = Restore all defaults
keys-about = Add gives a control another key; Clear removes all its keys
keys-add = Add
keys-add-about = Add another key
# $does: what the control does, one of those below.
keys-add-to = Add a key: { $does }
keys-clear = Clear
keys-clear-about = Remove its keys
keys-clear-of = Clear the keys: { $does }
keys-press = Press a key or button for: { $does }
# $controls: what each of them does.
keys-unbound = Nothing is bound to: { $controls }
# In the place of a control's keys.
keys-none = nothing
# $does: what the key does already, $name: what that control is called in the settings file.
keys-taken = { $key } is taken: it does "{ $does }" ({ $name })
keys-use = Use it here instead
keys-leave = Leave it
# $name: what the control is called in the settings file.
keys-not-held = { $key } cannot be held down, which "{ $name }" needs
# The names of keys are those of the settings file, in English.
keys-unknown = `{ $word }` is no key, button or wheel: write for example "W", "F5", "Left Shift", "Mouse right" or "Wheel up"

# Headings of the list of controls, and what each control does.
controls-aim = Aim
controls-mouse = Mouse
controls-mouse-aims = aim: left and right turn the cue
control-aim-left = turn the cue one degree to the left
control-aim-right = turn the cue one degree to the right
control-aim-at-pointer = aim at the pointer
control-fine = hold for fine control (a tenth of each step)
control-aim-aids = cycle the aim aids: none, cue line, ghost ball, full prediction

controls-stroke = Stroke
control-stroke = hold, pull the mouse back, release to strike
control-charge = hold to raise the power, release to strike
control-swing = hold and stroke with the mouse: the cue follows your hand
control-strike = strike with the set power
control-power-up = increase the power
control-power-down = decrease the power

controls-spin = Spin and elevation
control-tip-up = move the tip up (follow)
control-tip-down = move the tip down (draw)
control-tip-left = move the tip left (left english)
control-tip-right = move the tip right (right english)
control-tip-center = center the tip and level the cue
control-cue-up = raise the butt of the cue (jump, massé)
control-cue-down = lower the butt of the cue

controls-view = View
control-orbit = hold and move the mouse to look around; cancels a stroke
control-look-down = tilt the view up, towards a plan view
control-look-left = turn the view to the left
control-look-right = turn the view to the right
control-look-up = tilt the view down, towards the cloth
control-zoom-in = zoom in
control-zoom-out = zoom out
control-next-view = next view: behind the cue, overhead, free, follow, pocket
control-overhead = toggle the overhead view
control-view-1 = recall saved view 1
control-view-2 = recall saved view 2
control-view-3 = recall saved view 3
control-view-4 = recall saved view 4
control-keep-view-1 = save this view as view 1
control-keep-view-2 = save this view as view 2
control-keep-view-3 = save this view as view 3
control-keep-view-4 = save this view as view 4

controls-game = Game
control-pick-up = pick up or put down a cue ball in hand
control-call = cycle the call: each pocket, safety, push-out, none
control-undo = undo the last shot
control-redo = redo the shot that was undone
control-skip = skip the computer's aim, then the shot
control-suggest = suggest a shot
control-take-over = let the computer play this shot
control-log = toggle the match log
control-rack = rack the balls again (free table)
control-look-back = open the replay of previous shots
control-practise = open the practice table
control-photograph = take a screenshot in full quality (PNG and EXR)
control-help = toggle this help
control-stats = cycle the statistics: in words, figures, full, full with recording, off
control-fullscreen = toggle fullscreen
control-menu = cancel the stroke, or open the menu

controls-replay = Replay
control-replay-pause = pause or resume
control-replay-back = rewind 0.1 s
control-replay-forward = skip forward 0.1 s
control-replay-event-before = previous event
control-replay-event-next = next event
control-replay-shot-before = previous shot
control-replay-shot-next = next shot
control-replay-speed-1 = normal speed
control-replay-speed-2 = a quarter of normal speed
control-replay-speed-3 = a tenth of normal speed


## Balls

# $number: the number on the ball, 0 for the cue ball.
ball = { $number ->
    [0] the cue ball
   *[other] the { $number }
}

## Gamepads

# $name: what the gamepad calls itself.
gamepad-connected = Gamepad connected: { $name }

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
stats-state-syncing = syncing
# $bytes, $of: megabytes of the scene that the node has, and of all.
stats-state-syncing-bytes = syncing, has { $bytes } of { $of } MB
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
stats-resume = Resume
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

## Notices

replay-nothing-yet = No shot to replay yet
replay-other-table = Recorded on another table ({ $table }): start the game with --replay and the file
saved-as = Saved as { $path }
aids-chosen = Aim aids: { $name }
view-saved = Saved view { $number }: press { $key } to recall it
view-empty = View { $number } is empty: press { $key } to save this view
screenshot-cancelled = The screenshot was cancelled
film-cancelled = The film was cancelled
farm-failed = Rendering unavailable: { $why }
screenshot-no-farm = Nothing can render yet: the farm is starting
screenshot-failed = Screenshot failed: { $why }
film-failed = Film failed: { $why }
screenshot-progress = Rendering the screenshot: { $percent } %. Press its key again to cancel it
ball-carried = The cue ball follows the mouse: click to put it down
match-waits = Practice from here; your match waits: go back to it from the menu
match-resumed = Resumed your match of { $game }; start another from the menu
match-not-resumed = Cannot resume the unfinished match: { $why }
match-kept-aside = Its file is kept as { $path }
match-set-aside = Your unfinished match of { $game } is kept as { $path }: to go on with it, rename that file to { $name } while the game is closed
window-title = Carom

## Nodes

farm-cpu-only = No GPU found: rendering on the CPU ({ $threads } threads), at lower resolution while things move
node-again = { $name } is connected again
# $others: whether other nodes are left.
node-lost = Lost { $name } ({ $why }): { $others ->
    [yes] other nodes take over its tiles
   *[no] the last frame stays until a node connects
}
# $others: whether other nodes are left.
node-unusable = Cannot use { $name } ({ $why }): { $others ->
    [yes] other nodes take over its tiles
   *[no] the last frame stays until a node connects
}
node-slow = { $name } is { $times } times slower than the fastest node and gets fewer tiles
node-slow-ends = { $name } has caught up with the other nodes and gets more tiles again
node-doubted = { $name }: { $doubt }, and one of them is wrong
node-far = High latency to { $name } ({ $ms } ms round trip): frames are requested earlier and may be less precise
farm-waiting = Waiting for the first frame
farm-sending = Sending the scene: { $bytes } of { $of } MB
farm-no-node = Rendering unavailable: no node is connected ({ $nodes }). Retrying every 5 s; you can keep playing
node-local-device = this machine ({ $device })
farm-nodes = { $ready } of { $all } nodes: { $names }
node-local = This machine

## Sound

sound-by = Played by { $name }
sound-failed = No sound: { $name }: { $why }
sound-none = No sound: none of { $programs } is installed. On Debian or Ubuntu `apt install alsa-utils` brings aplay

## Settings file

settings-no-key-left = nothing is left for "{ $does }": give [keys] { $name } a key
settings-ignored = ignored [{ $table }] { $key } = { $value }: it must be { $wanted }
settings-unknown = unknown setting { $name }: left unchanged
settings-broken = it cannot be read, so the defaults apply; it is kept as settings.broken.toml when a setting changes: { $why }
# $steps: physics steps a second, 0 for the exact engine.
engine-cost = { $steps ->
    [0] Billiards laws from contact to contact
   *[other] Plain rapier, { $steps } steps a second
}: a 30° cut is off by { $cut }°, a usual shot by { $shot } mm; { $time } ms of CPU for a break
engine-unmeasured = { $steps ->
    [0] Billiards laws from contact to contact
   *[other] Plain rapier, { $steps } steps a second
}: `carom --help` says what others cost and lose

## Play

aids-off = no aids
aids-line = cue line
aids-ghost = ghost ball
aids-full = full prediction
ball-not-in-hand = The cue ball is not in hand: it is played from where it lies
view-chosen = View: { $name }
miscue = Miscue: the tip slipped off the ball
no-re-rack = You cannot re-rack in a match. Esc → New game
undo-wait = Wait until the balls rest before you undo
redo-wait = Wait until the balls rest before you redo
undone = { $shots ->
    [0] Nothing to undo
    [one] Undid the last shot
   *[other] Undid the last { $shots } shots
}
redone = { $shots ->
    [0] Nothing to redo
    [one] Redid the last shot
   *[other] Redid the last { $shots } shots
}
suggestion-search = Looking for a shot …
layout-other-table = The layout is of another table ({ $table })
farm-error = The farm: { $why }
render-not-started = The render cannot start: { $why }
practice-not-clear = It must lie on the cloth, clear of cushions, pockets and other balls
practice-on-table = { $ball } is on the table already
practice-not-on-table = { $ball } is not on the table
practice-no-room = there is no room for { $ball } on the table
screenshot-saved = Saved the screenshot as { $path } and, with albedo, normal and depth, as .exr
film-saved = Saved the film as { $path }

## Events of a shot

event-strike = the cue strikes at { $speed } m/s
event-miscue = the tip slips off
event-hit = { $first } hits { $second }
event-cushion = { $ball } meets a cushion
event-potted = { $ball } is potted
event-left-table = { $ball } leaves the table
shot-numbered = Shot { $number }
shot-title = Shot { $number }: { $events }
view-shooter = behind the cue
view-overhead = from above
view-orbit = free
view-follow = after the ball
view-pocket = from the pocket

## Window and files

window-library-failed = the windowing library failed
variable-not-set = { $name } is not set
# $wayland, $x11: environment variables with their values. $instead: a command.
window-not-opened = no window can be opened ({ $wayland }, { $x11 }). On Debian or Ubuntu `apt install libx11-xcb1 libxcursor1 libxi6 libxkbcommon-x11-0` brings what X11 needs; `{ $instead }` needs no display at all
surface-outdated = stays outdated
surface-lost = was lost
surface-invalid = is not valid
display-vulkan = Vulkan
display-opengl = OpenGL
display-software = software
farm-not-started = it could not be started
file-unwritable = { $path } cannot be written
file-not-written = { $path } cannot be written: { $why }. Free some space or change who may write there, then try again
settings-no-folder = Settings cannot be saved: { $why }
settings-too-long = it is longer than { $bytes } bytes
# Over a table: the spaces place each word over its column.
engine-table =
    { "             30° cut at  reference   energy kept  CPU ms per  CPU ms for  dearest" }
    { "             3 m/s, off  shots, off  in a break   simulated   a whole     10 ms," }
    { "             by          (median)    (real: 76 %) second      break       CPU ms" }

## Fouls, each to follow "fouled: "

foul-scratch = the cue ball fell into a pocket
foul-cue-ball-off = the cue ball left the table
foul-no-ball-hit = the cue ball touched no ball
foul-wrong-ball = { $hit } was hit first; legal was { $on }
foul-no-rail = no ball reached a cushion after the contact
foul-ball-off = { $ball } left the table
foul-double-hit = the tip met the cue ball twice, so close to { $ball }
foul-behind-head-string = { $ball } lies behind the head string, which the cue ball had to cross first
foul-weak-break = the break drove { $driven } balls to a cushion; it takes { $needed }, or a ball potted
foul-wrong-pot = { $ball } was potted, and was not on
foul-jump = the cue ball jumped over { $ball }
foul-push-stroke = the cue ball touched { $ball } and was played into it
foul-free-ball-snooker = the next player is snookered behind { $ball }, the free ball

## Choices

choice-accept = Play the balls as they lie
choice-return = Let the other player shoot
choice-rerack-return = Rack again and let the other player break
choice-rerack = Rack again and break
choice-take-in-hand = Take the cue ball in hand
choice-spot-balls = Set up the balls that touch

## Verdicts. Before those that begin with a small letter the name of the player who played is put.

eight-off-table = the 8 left the table
eight-too-early = the 8 fell before the group was cleared
eight-on-foul = the 8 fell on a foul
eight-on-safety = the 8 fell on a safety
eight-wrong-pocket = the 8 fell into a pocket that was not called
eight-as-called = The 8 fell as called
eight-took = took { $group } { $sign }
eight-lost = lost the rack: { $why }
eight-weak-break = broke illegally: { $balls } balls reached a cushion, it takes 4 or a ball potted
eight-open = The table is open
eight-spotted = The 8 is spotted
turn-passes-safety = A safety was called: the turn passes
turn-passes-pocket = { $ball } was called in { $pocket }: it did not fall there, the turn passes
turn-passes-no-call = No ball and pocket were called, and none were obvious: the turn passes
state-points = { $points } points
state-attempt = attempt { $attempt } of { $all }
state-run = break { $run }
state-fouls = fouls in a row: { $fouls }
verdict-conceded = conceded
verdict-chose = chose to { $choice }
verdict-fouls-warning = { $fouls } fouls in a row: one more is punished
verdict-fouls-punished = { $fouls } fouls in a row
verdict-reached = reached { $points } points
verdict-in-hand = Ball in hand { $area }
verdict-fouled = fouled: { $reasons }
verdict-points-to-other = { $points } points to the other player
verdict-scored = scored { $points }, a break of { $run }
verdict-frame-over = Frame over, { $first } to { $second }
verdict-tie = A tie: the black is spotted again, and the next score or foul decides
verdict-free-ball = Free ball
nine-won = The 9 fell on a legal shot
nine-spotted = The 9 is spotted
nine-push-out = A push-out: the other player decides who shoots
straight-three-fouls = Three fouls in a row: all balls are racked, and the same player breaks
straight-spotted = Spotted: { $balls }
straight-fourteen = Fourteen balls are racked again
carom-scored = scored a point off { $cushions } cushions
carom-too-few = { $cushions } cushions before the second ball: it takes { $needed }
free-spotted = { $ball } left the table and is spotted
free-cue-ball-lost = The cue ball is lost: put it where you like
free-clear = The table is clear
verdict-missed = missed
verdict-no-room = There is no room for { $ball }

## The balls that may be hit first, to follow "legal was" and "You are on"

on-any-but-8 = any ball but the 8
on-any = any ball
on-red = a red
on-colour = a colour
on-free-ball = { $on }, with a free ball

## Places on the table

area-anywhere = anywhere on the table
area-kitchen = behind the head string
area-d = in the D
pocket = a pocket
# As seen from the head of the table.
pocket-named = { $along ->
    [side] { $across ->
        [left] the left side pocket
       *[right] the right side pocket
    }
    [foot] { $across ->
        [left] the left foot corner
       *[right] the right foot corner
    }
   *[head] { $across ->
        [left] the left head corner
       *[right] the right head corner
    }
}

## Games

game-free = Free table
game-eight = 8-ball
game-nine = 9-ball
game-straight = Straight pool
game-snooker = Snooker
game-three-cushion = Three-cushion
game-line-up = Line-up
game-spot-shots = Spot shots
game-position-play = Position play
game-daily-shot = Daily shot
ball-snooker = { $number ->
    [16] the yellow
    [17] the green
    [18] the brown
    [19] the blue
    [20] the pink
    [21] the black
   *[other] a red
}
ball-carom = { $number ->
    [1] the other cue ball
   *[2] the red
}
group-solids = solids
group-stripes = stripes
level-easy = easy
level-medium = medium
level-hard = hard
level-expert = expert

## Match

goal-racks = { $target ->
    [1] one rack
   *[other] first to { $target } racks
}
goal-frames = { $target ->
    [1] one frame
   *[other] first to { $target } frames
}
goal-points = { $target ->
    [1] one point
   *[other] first to { $target } points
}
goal-attempts = { $target ->
    [1] one attempt
   *[other] { $target } attempts
}
call-safety = a safety
call-push-out = a push-out
call-pot = { $ball } in { $pocket }
result-points = { $name } made { $score } of { $most } points
result-won = { $name } won the match
prompt-free = Play as you like
prompt-break = Break
prompt-on = You are on { $on }
prompt-in-hand = { $prompt }. Ball in hand { $area }
# $call, $potted: what was called and what fell, `none` for nothing.
log-shot = { $number }. { $player }{ $call ->
    [none] {""}
   *[other] {" "}called { $call }
}: { $potted ->
    [none] no ball potted
   *[other] potted { $potted }
}
log-next = Next: { $player }
player-computer = Computer ({ $level })
player-numbered = Player { $number }

## Suggestions

hint-put-at-mark = put the cue ball at the mark
intention = { $name } will { $target }
intention-choice = { $name }: { $choice }
hint-play = play { $call }
hint-break = break
hint-safe-off = play safe off { $ball }
hint-hit = hit { $ball }
hint-safe-cushions = play safe by the cushions
hint-cushions = play by the cushions
tip = { $place ->
    [low] tip low, { $speed } m/s
    [high] tip high, { $speed } m/s
    [left] tip on the left, { $speed } m/s
    [right] tip on the right, { $speed } m/s
    [low-left] tip low on the left, { $speed } m/s
    [low-right] tip low on the right, { $speed } m/s
    [high-left] tip high on the left, { $speed } m/s
    [high-right] tip high on the right, { $speed } m/s
   *[middle] tip in the middle, { $speed } m/s
}

## Refusals

place-not-on-cloth = The cue ball must lie on the cloth, clear of the cushions
place-touches = The cue ball must not touch another ball
layout-not-free-table = Balls are laid on the free table: the menu begins one
hint-match-over = The match is over: there is no shot to suggest
place-outside = The cue ball is in hand { $area }

## Viewer

view-title = Carom viewer
view-title-file = { $file } – Carom viewer
view-drop = Drop a scene on this window
# $endings: .json, .obj and others.
view-drop-endings = A file whose name ends with one of { $endings }
view-hint = F1 shows the keys
view-reading = Reading { $file } …
view-refusal-close = Esc closes this
view-fault = No pictures: { $why }
view-dark = All lights are off
view-file-saved = Saved { $path }
view-not-saved = Not saved: { $why }
view-save-cancelled = it was cancelled
view-film-cancelled = it was cancelled after { $done } of { $frames } frames; saved under the same name again, it goes on with them
# The line under the picture.
view-line = { $file } · { $samples } of { $all } samples · F1 keys
view-line-draft = { $file } · F1 keys

# The panel.
view-contents = { $objects ->
    [one] 1 object
   *[other] { $objects } objects
}, { $triangles ->
    [one] 1 triangle
   *[other] { $triangles } triangles
}, { $lights ->
    [one] 1 lamp
   *[other] { $lights } lamps
}
view-exposure = Exposure
view-exposure-about = Powers of two: one more is twice as bright. Files of 8 bits show it too.
view-fov = Field of view
view-camera = Camera
# Of one without a name.
view-camera-number = Camera { $number }
view-camera-free = Free
view-camera-about = A camera of the file, which moves with its animation, or the free one: the view is that as soon as you move it.
view-upright = upright
view-home = Home
view-pause = Pause
view-pause-about = Gathers no more samples, so that this machine and its nodes are free. Changes are still shown.
view-animation = Animation
# Of one without a name.
view-animation-number = Animation { $number }
view-play = Play
view-stop = Stop
view-play-about = While it plays pictures are drafts; stopped, they gather samples.
view-time = Time
view-speed = Speed
view-lights = Lights
view-sky = Sky
view-save = Save
view-save-file = File
view-save-file-about = A still ends with .png, .jpg or .exr (32 bits, with albedo, normal and depth), a film with .png (animated) or .y4m.
view-save-size = Size
view-save-samples = Samples
view-save-frames = Turntable frames
view-save-range = Animation frames
view-save-rate = Frames per second
view-save-still = Save still
view-save-still-about = A picture of what is seen.
view-save-turntable = Save turntable
view-save-turntable-about = A film that goes once round the target.
view-save-animation = Save animation
view-save-animation-about = A film of these frames of the animation, seen through the camera that is chosen. Frame 0 is its start.
view-save-cancel = Cancel

# Keys and mouse, and what each does.
view-help = Keys and mouse
view-help-close = F1 or Esc closes this
view-key-orbit = Left mouse button
view-does-orbit = go round the target
view-key-pan = Middle mouse button, or Shift and left
view-does-pan = shift the picture
view-key-look = Right mouse button
view-does-look = look around from where you are
view-key-zoom = Wheel
view-does-zoom = go nearer or farther away
view-key-walk = W, A, S, D
view-does-walk = walk forward, left, backward, right
view-key-rise = E, Q
view-does-rise = rise, sink
view-key-fast = Shift with these
view-does-fast = four times as fast
view-key-home = Home
view-does-home = back to the scene's own view and exposure
view-key-camera = C
view-does-camera = back to the file's camera; from there to its next
view-key-exposure = + and -
view-does-exposure = half a stop brighter or darker
view-key-lights = 0 to 9
view-does-lights = switch the sky (0) and the lamps
view-key-play = Space
view-does-play = play the scene's animation, or stop it
view-key-pause = P
view-does-pause = gather no more samples, or go on
view-key-save = Ctrl S
view-does-save = save a still
view-key-reload = R
view-does-reload = read the file again; it is read by itself when it changes
view-key-panel = F2
view-does-panel = panel at the left
view-key-statistics = F3
view-does-statistics = statistics of the farm: a line, figures, everything, recorded
view-key-help = F1
view-does-help = these keys
view-key-fullscreen = F11
view-does-fullscreen = fill the screen
view-key-quit = Ctrl Q
view-does-quit = close the window
