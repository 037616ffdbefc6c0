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
