# The texts of Carom's user interface, in the syntax of Project Fluent (https://projectfluent.org/fluent/guide/).
#
# A translation is a copy of this file with the right-hand sides translated. Identifiers and { $arguments } stay.

## Menu

menu-title = Carom
menu-resume = Resume
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
menu-try-again = Try again
menu-back-to-table = Back to the table

## New game

new-game-rules = Game
new-game-drill = Drill
new-game-against = Against
new-game-person = A person at this machine
new-game-person-about = You take turns with mouse and keys
# $level: easy, medium, hard or expert.
new-game-computer = Computer, { $level }
# A heading over numbers to choose from. $unit: what is counted, as racks or points.
new-game-first-to = First to, { $unit }
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
setting-ball-set-glass-about = Glass: stripes are paler, and each ball throws its colour onto the cloth
setting-ball-set-jade = Jade
setting-ball-set-jade-about = Jade and other translucent stone: stripes are paler
setting-ball-set-metal = Metal
setting-ball-set-metal-about = Anodised metal in the balls' colours: solids polished, stripes brushed

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
setting-quality-smooth-about = 60 pictures a second where 426x240 pixels allow it
setting-quality-balanced = Balanced
setting-quality-balanced-about = 60 a second where they are fine enough, else 30: twice the paths
setting-quality-fine = Fine
setting-quality-fine-about = 15 a second: four times the paths, a seventh of the error

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
# $state: the player's group and the like, may be empty; $balls: numbers of the balls that are left.
match-left = { $state } · left: { $balls }
match-call = Call
match-called = { $call } (called)
match-called-by-aim = { $call } (by your aim)
match-nothing-called = Nothing yet: aim at a pot or click a pocket, else your turn ends even if a ball drops
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

# ---- statistics ----

## Balls

# $number: the number on the ball.
ball-numbered = the { $number }
