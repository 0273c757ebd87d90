"""proto"""
import numpy as np
from harvester.averaging.layers import Grid, faced, layered
from harvester.averaging.lobes import HalfOrbits, Lobe
from harvester.averaging.transport import Problem
from harvester.errors import AveragingError

FORGOTTEN = 40.0

def stiffness(p):
    w = p.angular_frequency
    return p.coupling * w * w / (p.decay_rate**2 + w * w)

def thermal(p):
    w = p.angular_frequency
    t = p.relaxation_time
    t = t if np.isfinite(t) else p.correlation_time
    return p.intensity * t / (1 + (w * p.correlation_time) ** 2)

def reach(p, k):
    """excess"""
    lobe = Lobe(p, k, 0.0)
    unit = thermal(p)
    scan = unit * np.exp(np.linspace(-12, 20, 129))
    half = HalfOrbits.of(lobe, lobe.outer_path(scan, 16))
    half = half.after_mirrored(half)
    noise = p.intensity * half.filtered_power(1 / p.correlation_time) / p.correlation_time**2
    loss = p.damping * half.area + half.integral(half.speed * half.damping) + p.coupling * p.decay_rate * half.filtered_power(p.decay_rate)
    rate = loss / noise
    ex = np.insert(np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(scan)), 0, 0) + rate[0] * scan[0]
    i = np.searchsorted(ex, FORGOTTEN)
    if i >= len(scan):
        raise AveragingError("not bounded")
    one = np.interp(1.0, ex, scan)
    return scan[i], one

def clustered(n, scale):
    """0..1 with cells near 0 on scale"""
    xi = np.linspace(0, 1, n + 1)
    if scale >= 1.0: return xi
    a = np.arcsinh(1 / scale)
    f = np.sinh(a * xi) / np.sinh(a)
    f[-1] = 1.0
    return f

def grid(p, k, n):
    nz, nw, no, nodes = n
    far, one = reach(p, k)
    excess = far * clustered(no, one / far)
    bist = p.linear_stiffness < 0
    if not bist:
        return Grid(np.zeros(2), np.empty(0), excess, nodes)
    lobe = Lobe(p, k, 0.0)
    H = thermal(p)
    w = p.angular_frequency
    rest = p.rest
    # shift of centre
    shift = min(1.0, 1.5 * p.cubic_stiffness * H * 2/ w**4)
    charge = rest * (1 - clustered(nz, min(1.0, 4 * shift))[::-1])
    charge[0] = 0.0; charge[-1] = rest
    share = np.empty(0)
    if lobe.double:
        share = clustered(nw, min(1.0, 2 * np.sqrt(H / (3 * lobe.depth))))
    return Grid(charge, share, excess, nodes)

def solve(p, n):
    k = stiffness(p)
    g = grid(p, k, n)
    tables = layered(p, k, g)
    faces = faced(p, k, g, tables) if g.charge[-1] > 0 else None
    pr = Problem(p, g, tables, faces)
    dens = pr.solve()
    m = dict(mass=0., v_ac=0., v_slow=0., contact=0., vel=0., disp=0., wells=0., neg=0.)
    for name, t in tables.items():
        d = dens[name]; z, wd = pr.layers[name]
        f = d * wd[:, None]
        m["neg"] = min(m["neg"], (pr.volume(name)*d).min()); m["gneg"]=d.min()/d.max()
        J = t.cells("area")
        mass = (f * J)
        m["mass"] += mass.sum()
        if name == "wells": m["wells"] = mass.sum()
        m["vel"] += (f * t.cells("speed_square")).sum()
        m["disp"] += (f * t.cells("square")).sum()
        dH = np.diff(t.face_height, axis=1)
        m["contact"] += (f * 0.5 * (t.contact[:, 1:] + t.contact[:, :-1]) * dH).sum()
        m["v_ac"] += (f * 0.5 * (t.voltage[:, 1:] + t.voltage[:, :-1]) * dH).sum()
        c = np.divide(t.cells("displacement"), J, out=np.zeros_like(J), where=J > 0)
        m["v_slow"] += (mass * (c - z[:, None]) ** 2).sum() * (k / p.coupling if p.coupling else 1)
    V = m["v_ac"] + m["v_slow"]
    loss = p.damping * m["vel"] + m["contact"]; pw = p.coupling * p.decay_rate * V
    m["V2"] = V; m["pce"] = pw / (pw + loss); m["in"] = (pw + loss) / p.intensity
    return m, pr, dens
