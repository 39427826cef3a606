"""Learning: policies and rewards from demonstrations (AIRL, behaviour cloning), and their transfer (TRPO)."""

from vic_toolbox.errors import require

require("learn", "torch", "safetensors", "threadpoolctl")

from vic_toolbox.learning.airl import Airl, AirlConfiguration
from vic_toolbox.learning.checkpoints import load_policy, load_reward, save_policy, save_reward
from vic_toolbox.learning.cloning import CloningConfiguration, clone
from vic_toolbox.learning.expert_data import ExpertData
from vic_toolbox.learning.networks import GaussianPolicy
from vic_toolbox.learning.policy_search import PolicySearch, PolicySearchConfiguration
from vic_toolbox.learning.recipes import Recipe, recipe
from vic_toolbox.learning.reward import DiscriminatorConfiguration, RewardNetwork
from vic_toolbox.learning.rollouts import Rollout, collect
from vic_toolbox.learning.transfer import Transfer, TransferConfiguration
from vic_toolbox.learning.trpo import TrpoConfiguration

__all__ = [
    "Airl",
    "AirlConfiguration",
    "CloningConfiguration",
    "DiscriminatorConfiguration",
    "ExpertData",
    "GaussianPolicy",
    "PolicySearch",
    "PolicySearchConfiguration",
    "Recipe",
    "RewardNetwork",
    "Rollout",
    "Transfer",
    "TransferConfiguration",
    "TrpoConfiguration",
    "clone",
    "collect",
    "load_policy",
    "load_reward",
    "recipe",
    "save_policy",
    "save_reward",
]
