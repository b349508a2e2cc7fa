"""The figures of a study: rates and times along axes, maps, survival, age, differences."""
