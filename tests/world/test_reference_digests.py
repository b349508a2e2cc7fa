"""Reference digests: what the shipped scenarios come to, as they are and over a bad radio.

A change that is not meant to change runs changes none of these. ``LOSSY`` has bursts, gamma delays,
noise, moved starts and relaying.
"""

import pytest

import encircle

LOSSY = (
    'channel.loss={model="gilbert-elliott", good_to_bad=0.1, bad_to_good=0.3}',
    'channel.delay={model="gamma", mean_s=0.3, std_s=0.2}',
    "sensing.noise_m_std=0.05",
    "team.jitter_m=0.25",
    "robot.detections=relay",
)
RADIOS = {"plain": (), "lossy": LOSSY}
DIGESTS = {
    ("sim1", "plain", 1): "12791190669dacb76be1e647f126424f",
    ("sim1", "plain", 2): "b91bb0608f69ff0dec7b7ef7a79e5546",
    ("sim1", "lossy", 1): "93bebdc0216286ab6d1c94ca003a07c7",
    ("sim1", "lossy", 2): "848003fa358e69427a1537678a945096",
    ("sim2", "plain", 1): "3ad105125dd598b009a25ed35e57e206",
    ("sim2", "plain", 2): "5c7e1c38370e22b0be2a845a86941e55",
    ("sim2", "lossy", 1): "d5b1e294d103b0f436b42ebb5151e281",
    ("sim2", "lossy", 2): "d667d7e67de6f8bd2b3799ff70efedb5",
    ("sim3", "plain", 1): "e61b107618db35405f3564830d3b2661",
    ("sim3", "plain", 2): "5bd5b42f120e0e55dccaba0b572e8d1d",
    ("sim3", "lossy", 1): "5d5965f6a3bca2303d80cec800a52a5b",
    ("sim3", "lossy", 2): "4480b5613da1f5d293c27c08b57b6171",
    ("sim4", "plain", 1): "baac072ae5442e8d743105b30eaa6a72",
    ("sim4", "plain", 2): "e85c0e962d1e62dae27a0d67fb3ebd88",
    ("sim4", "lossy", 1): "0abff5713394c7e31a9af680e40b4114",
    ("sim4", "lossy", 2): "165cc6380a7f7cf43047f1dcb82b93cc",
    ("sim5", "plain", 1): "13544f21ac58e6dbcf3e5de72ae72abf",
    ("sim5", "plain", 2): "3900b3c53efe2494ebf855aedf68382d",
    ("sim5", "lossy", 1): "f15da9d650ed5016e9ba66d1175c8160",
    ("sim5", "lossy", 2): "f4ff4af515d5b78339c23cac333fc017",
}


@pytest.mark.parametrize(("name", "radio", "seed"), DIGESTS)
def test_the_digest_is_the_reference(name, radio, seed):
    """A change here changes published numbers: say so in the changelog."""
    hunt = encircle.run(name, link="memory", overrides=[*RADIOS[radio], f"seed={seed}"])
    assert hunt.digest == DIGESTS[name, radio, seed]
