"""How a path looks on a map: the blue of the pictures, thin lines, faint ellipses."""

BLUE = "#0072b2"
LINE_WIDTH = 3
FILL_OPACITY = 0.08
