"""Costs (2), one file each."""

from .goal_obstacles import GoalObstacleCost

__all__ = ["GoalObstacleCost"]
