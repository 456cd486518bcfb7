"""The paper in 200 lines: learn a metric from demonstrations, and follow its geodesics around an obstacle.

H. Beik-Mohammadi, S. Hauberg, G. Arvanitidis, G. Neumann, L. Rozo, "Reactive Motion Generation on Learned Riemannian
Manifolds", IJRR 2023 (arXiv 2203.07761), for poses of a tool: positions x in R^3, unit quaternions q in S^3.

    likelihood      p(x, q | z) = N(x | mu, diag sigma^2) (vMF(q | nu, kappa) + vMF(q | -nu, kappa)) / 2, all of z
    precisions      1 / sigma(z), kappa(z) = W exp(-|z - c|^2 / (2 h^2)) + floor, W > 0: unsure far from the data
    training        ELBO = E_q(z | x, q)[log p(x, q | z)] - KL(q(z | x, q) || N(0, I))
    metric          M = J_mu' J_mu + J_sigma' J_sigma + J_nu' J_nu + J_k' J_k
    edge (u, v)     w = |f(v) - f(u)| with f = (mu, sigma, nu, k), the chord: w^2 = dz' M dz for small dz
    ambient metric  m(p) = 1 + zeta exp(-|p - o|^2 / (2 r^2)) at a point p, for an obstacle of radius r at o
    reweighting     w = sqrt((m(u) + m(v)) / 2 (|dmu|^2 + |dsigma|^2) + |dnu|^2 + |dk|^2)
    geodesic        the shortest path on the grid, a cubic spline through it by least squares, decoded

Not the paper's: k is kappa^(-1/2), where kappa itself, thousands, drowns metres; the floor, which is the walls' height,
and h, which it leaves open; sigma and kappa fixed while codes settle, so that kernels can stand there; nu's first side.
"""

import argparse
import math

import matplotlib.pyplot as plt
import numpy as np
import torch
from scipy import cluster, interpolate, sparse, spatial
from torch import nn

# 1 / sigma [1/m] of the three coordinates and kappa: while the codes settle, and far from all data.
FIXED, FAR = torch.tensor([[200.0, 200.0, 200.0, 1600.0], [1.0, 1.0, 1.0, 0.01]], dtype=torch.float64)


def demonstrations(count=5, samples=80, seed=0):
    """A letter D, stem and bow `count` times each: positions (2 count, samples, 3) [m], quaternions w, x, y, z."""
    rng, s = np.random.default_rng(seed), np.linspace(0.0, math.pi, samples)
    stem = np.stack([0.0 * s, 0.3 * s / math.pi - 0.15, 0.0 * s], axis=1)
    bow = np.stack([0.2 * np.sin(s), -0.15 * np.cos(s), 0.05 * np.sin(s)], axis=1)
    x = np.repeat([stem, bow], count, axis=0) + np.sin(s)[:, None] * rng.uniform(-0.015, 0.015, (2 * count, 1, 3))
    x = x + rng.normal(0.0, 0.001, x.shape)  # [m], a sensor's noise
    lean = 3.0 * np.cross([0.0, 0.0, 1.0], x) + rng.normal(0.0, 0.01, x.shape)  # outwards, 3 rad a metre
    turns = spatial.transform.Rotation.from_rotvec(lean.reshape(-1, 3))
    return x, turns.as_quat(scalar_first=True).reshape(*x.shape[:2], 4)


class PoseVAE(nn.Module):
    """Encoder q(z | x, q) and decoder p(x, q | z) of poses; the latent space is a plane."""

    def __init__(self, x, q):
        super().__init__()
        self.offset, self.scale, self.centres = x.mean(0), x.std(), None
        self.encoder = nn.Sequential(nn.Linear(7, 64), nn.Tanh(), nn.Linear(64, 32), nn.Tanh(), nn.Linear(32, 4))
        self.decoder = nn.Sequential(nn.Linear(2, 32), nn.Tanh(), nn.Linear(32, 64), nn.Tanh(), nn.Linear(64, 7))
        # To the mixture q and -q are the same: nu begins near one of them everywhere.
        self.decoder[-1].bias.data[3:] = torch.linalg.eigh(q.T @ q).eigenvectors[:, -1]

    def encode(self, x, q):
        """Mean and log variance (n, 2) of q(z | x, q)."""
        return self.encoder(torch.cat([(x - self.offset) / self.scale, q], dim=1)).chunk(2, dim=1)

    def place_kernels(self, codes, count):
        """Kernels on the k-means of codes (n, 2), as wide as those are apart."""
        centres = cluster.vq.kmeans2(codes.numpy(), count, minit="points", seed=0)[0]
        distances, _ = spatial.cKDTree(centres).query(centres, k=2)
        self.width, self.centres = np.median(distances[:, 1]), torch.tensor(centres)
        self.log_weights = nn.Parameter((FIXED / self.kernels(codes).sum(1).mean()).log().repeat(count, 1))

    def kernels(self, z):
        return torch.exp(-0.5 * torch.cdist(z, self.centres) ** 2 / self.width**2)

    def decode(self, z):
        """mu (n, 3) [m], sigma (n, 3) [m], nu (n, 4), kappa (n,) at latent points (n, 2)."""
        out = self.decoder(z)
        precisions = FIXED.expand(len(z), 4) if self.centres is None else self.kernels(z) @ self.log_weights.exp() + FAR
        mu, nu = self.offset + self.scale * out[:, :3], nn.functional.normalize(out[:, 3:], dim=1)
        return mu, 1.0 / precisions[:, :3], nu, precisions[:, 3]

    def elbo(self, x, q):
        """Evidence lower bound of poses (n, 3), (n, 4), with one draw of z each."""
        mean, log_variance = self.encode(x, q)
        mu, sigma, nu, kappa = self.decode(mean + torch.exp(0.5 * log_variance) * torch.randn_like(mean))
        gaussian = (-0.5 * ((x - mu) / sigma) ** 2 - sigma.log() - 0.5 * math.log(2.0 * math.pi)).sum(1)
        # vMF(q | nu, kappa) = C exp(kappa q'nu), C = kappa / ((2 pi)^2 I_1(kappa)), and i1e(k) = exp(-k) I_1(k).
        height, cosine = (kappa / (4.0 * math.pi**2 * torch.special.i1e(kappa))).log(), (q * nu).sum(1)
        vmf = height + torch.logaddexp(kappa * (cosine - 1.0), kappa * (-cosine - 1.0)) - math.log(2.0)
        divergence = 0.5 * (mean**2 + log_variance.exp() - 1.0 - log_variance).sum(1)
        return (gaussian + vmf - divergence).mean()


def train(positions, quaternions, steps=3000, kernels=200, batch=256, seed=0):
    """A PoseVAE of poses (n, 3), (n, 4), and their codes (n, 2): half of the steps with sigma and kappa fixed."""
    torch.manual_seed(seed)
    x, q = torch.tensor(positions), torch.tensor(quaternions)
    vae = PoseVAE(x, q).double()
    for together in (False, True):
        if together:
            vae.place_kernels(vae.encode(x, q)[0].detach(), kernels)
        optimiser = torch.optim.Adam(vae.parameters(), lr=3e-3)
        schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, steps // 2)
        for _ in range(steps // 2):
            rows = torch.randint(len(x), (batch,))
            optimiser.zero_grad()
            (-vae.elbo(x[rows], q[rows])).backward()
            optimiser.step()
            schedule.step()
    return vae.requires_grad_(False), vae.encode(x, q)[0].numpy()


def features(mu, sigma, nu, kappa):
    """f (n, 11): mu and sigma, which obstacles stretch, then nu and k."""
    return np.column_stack([mu, sigma, nu, kappa**-0.5])


def decode_grid(vae, codes, shape=(100, 100), margin=0.1):
    """Nodes (n, 2) of a grid over the latent box of codes (m, 2), and their features (n, 11)."""
    border = margin * np.ptp(codes, axis=0)
    sides = zip(codes.min(axis=0) - border, codes.max(axis=0) + border, shape, strict=True)
    nodes = np.stack(np.meshgrid(*(np.linspace(*side) for side in sides), indexing="ij"), axis=-1).reshape(-1, 2)
    return nodes, features(*vae.decode(torch.tensor(nodes)))


def grid_edges(shape):
    """Edges (m, 2) between each node of a grid and its eight neighbours, each once."""
    n = np.arange(math.prod(shape)).reshape(shape)
    pairs = (n[1:], n[:-1]), (n[:, 1:], n[:, :-1]), (n[1:, 1:], n[:-1, :-1]), (n[1:, :-1], n[:-1, 1:])
    return np.concatenate([np.stack([u.ravel(), v.ravel()], axis=1) for u, v in pairs])


def ambient_metric(points, centre, radius, zeta=1000.0):
    """m (n,) at points (n, 3) [m] for an obstacle at a centre (3,) with a radius [m]."""
    return 1.0 + zeta * np.exp(-0.5 * np.sum((points - centre) ** 2, axis=1) / radius**2)


def edge_weights(edges, f, m):
    """Lengths (e,) of edges (e, 2) by the features (n, 11) of their nodes and the ambient metric (n,) there."""
    squared = (f[edges[:, 1]] - f[edges[:, 0]]) ** 2
    return np.sqrt(m[edges].mean(axis=1) * squared[:, :6].sum(axis=1) + squared[:, 6:].sum(axis=1))


def shortest_path(edges, weights, start, goal):
    """Nodes (p,) of the cheapest path from one node to another, and its cost."""
    graph = sparse.csr_array((weights, edges.T), shape=[edges.max() + 1] * 2)
    cost, before = sparse.csgraph.dijkstra(graph, directed=False, indices=start, return_predecessors=True)
    path = [goal]
    while path[-1] != start:
        path.append(before[path[-1]])
    return np.array(path[::-1]), cost[goal]


def fit_spline(path, coefficients=10):
    """The cubic spline over [0, 1] that fits a path (n, 2) by least squares and has its ends."""
    length = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1)))
    count, ends = min(coefficients, len(path)), path[[0, -1]]
    knots = np.concatenate([np.zeros(3), np.linspace(0.0, 1.0, count - 2), np.ones(3)])
    basis = interpolate.BSpline.design_matrix(length / length[-1], knots, 3).toarray()
    inner = np.linalg.lstsq(basis[:, 1:-1], path - basis[:, [0, -1]] @ ends)[0]
    return interpolate.BSpline(knots, np.concatenate([ends[:1], inner, ends[1:]]), 3)


def draw_plane(axes, title, colour, nodes, f, m, codes, curve):
    """The latent plane: the magnification factor log sqrt det M under the ambient metric, codes (n, 2), and a curve."""
    stretched = f * np.where(np.arange(11) < 6, np.sqrt(m)[:, None], 1.0)
    side = math.isqrt(len(nodes))
    slopes = np.array(np.gradient(stretched.reshape(side, side, 11), axis=(0, 1)))
    magnification = 0.5 * np.linalg.slogdet(np.einsum("ixyf,jxyf->xyij", slopes, slopes))[1]
    axes.pcolormesh(*nodes.T.reshape(2, side, side), magnification, shading="gouraud", cmap="Blues_r")
    axes.plot(*codes.T, ".", color="white", markersize=1.0)
    axes.plot(*curve.T, color=colour, linewidth=2.5)
    axes.set(title=title, xticks=[], yticks=[])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", default="paper.png", help="picture to write (default: %(default)s)")
    parser.add_argument("--steps", type=int, default=3000, help="of the training (default: %(default)s, half a minute)")
    arguments = parser.parse_args()
    x, q = demonstrations()
    vae, codes = train(x.reshape(-1, 3), q.reshape(-1, 4), arguments.steps)
    nodes, f = decode_grid(vae, codes)
    start, goal = (np.argmin(np.linalg.norm(nodes - end, axis=1)) for end in codes[[0, x.shape[1] - 1]])
    figure, (*planes, task) = plt.subplots(1, 3, figsize=(13.0, 4.4), layout="constrained")
    task.plot(*x[..., :2].T, color="0.7", linewidth=0.8)
    edges, m = grid_edges((100, 100)), np.ones(len(nodes))
    for axes, name, colour in ((planes[0], "free", "tab:orange"), (planes[1], "with obstacle", "tab:red")):
        path, cost = shortest_path(edges, edge_weights(edges, f, m), start, goal)
        curve = fit_spline(nodes[path])(np.linspace(0.0, 1.0, 101))
        mu, _, nu, _ = (values.numpy() for values in vae.decode(torch.tensor(curve)))
        draw_plane(axes, f"latent plane, {name} (dark: short)", colour, nodes, f, m, codes, curve)
        task.plot(*mu[:, :2].T, color=colour, linewidth=2.5, label=f"{name}: {cost:.2f}")
        axis = spatial.transform.Rotation.from_quat(nu[::10], scalar_first=True).apply([0.0, 0.0, 1.0])
        task.quiver(*mu[::10, :2].T, *axis[:, :2].T, color=colour, width=0.005)
        if axes is planes[0]:
            centre, radius = mu[50], 0.03  # of an obstacle in the middle of the free path [m]
            m = ambient_metric(f[:, :3], centre, radius)
    task.add_patch(plt.Circle(centre[:2], radius, color="0.3", alpha=0.4, linewidth=0.0))
    task.set(title="the tool's paths, and how it leans", xlabel="x [m]", ylabel="y [m]", aspect="equal")
    task.legend(loc=(0.24, 0.31), fontsize=7, title_fontsize=8, frameon=False, title="Riemannian length")
    figure.savefig(arguments.out, dpi=120)


if __name__ == "__main__":
    main()
