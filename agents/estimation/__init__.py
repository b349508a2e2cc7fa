"""The target's track: a Kalman filter, and the spline that extrapolates it."""
