"""Costs (2), one file each; `penalties` has the shapes of their penalties on obstacles."""

from .goal_obstacles import GoalObstacleCost

__all__ = ["GoalObstacleCost"]
