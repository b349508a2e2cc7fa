/* The palette of encircle/scene/palette.py, which says what it means; a test holds them together. */
"use strict";

(window.encirclePage = window.encirclePage || {}).palette = {
  "robots": [
    "#0072B2",
    "#D55E00",
    "#009E73",
    "#CC79A7",
    "#E69F00",
    "#56B4E9"
  ],
  "themes": {
    "light": {
      "background": "#FFFFFF",
      "panel": "#F4F5F7",
      "ink": "#1B1F24",
      "muted": "#5B636E",
      "grid": "#E3E6EA",
      "line": "#B4BAC2",
      "obstacle": "#C4C8CE",
      "target": "#1B1F24",
      "ring": "#5B636E",
      "arrived": "#0072B2",
      "late": "#E69F00",
      "chance": "#D55E00",
      "signal": "#B4508A",
      "cut": "#7A818B",
      "crowd": "#1B1F24"
    },
    "dark": {
      "background": "#12161C",
      "panel": "#1B2129",
      "ink": "#F1F3F5",
      "muted": "#A3ABB6",
      "grid": "#252C36",
      "line": "#4A5461",
      "obstacle": "#3C4550",
      "target": "#F1F3F5",
      "ring": "#A3ABB6",
      "arrived": "#56B4E9",
      "late": "#E69F00",
      "chance": "#F0742A",
      "signal": "#CC79A7",
      "cut": "#8B94A0",
      "crowd": "#F1F3F5"
    }
  },
  "arrived": {
    "role": "arrived",
    "shape": "disc",
    "reach": 1.0
  },
  "late": {
    "role": "late",
    "shape": "diamond",
    "reach": 1.0
  },
  "lost": {
    "loss": {
      "role": "chance",
      "shape": "x",
      "reach": 0.5
    },
    "burst-loss": {
      "role": "chance",
      "shape": "star",
      "reach": 0.5
    },
    "trace-loss": {
      "role": "chance",
      "shape": "plus",
      "reach": 0.5
    },
    "distance-loss": {
      "role": "signal",
      "shape": "x",
      "reach": 0.7
    },
    "weak-signal": {
      "role": "signal",
      "shape": "star",
      "reach": 0.7
    },
    "out-of-range": {
      "role": "signal",
      "shape": "plus",
      "reach": 0.7
    },
    "sender-silent": {
      "role": "cut",
      "shape": "ring-x",
      "reach": 0.15
    },
    "receiver-silent": {
      "role": "cut",
      "shape": "box-x",
      "reach": 0.85
    },
    "outage": {
      "role": "cut",
      "shape": "x",
      "reach": 0.5
    },
    "partition": {
      "role": "cut",
      "shape": "bar",
      "reach": 0.5
    },
    "queue-full": {
      "role": "crowd",
      "shape": "box-x",
      "reach": 0.15
    },
    "contention": {
      "role": "crowd",
      "shape": "star",
      "reach": 0.5
    }
  },
  "unknownLoss": {
    "role": "chance",
    "shape": "x",
    "reach": 0.5
  }
};
