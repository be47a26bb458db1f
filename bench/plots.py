"""What the pictures of the benchmarks share. Needs Debian's python3-matplotlib."""
import matplotlib

matplotlib.use("Agg")
matplotlib.rcParams["svg.hashsalt"] = "lapseam"  # the same bytes each time
import matplotlib.pyplot as plt  # noqa: E402

COLORS = ["#1f77b4", "#ff7f0e", "#2ca02c", "#d62728", "#9467bd", "#8c564b", "#e377c2", "#7f7f7f", "#bcbd22", "#17becf"]


def new_figure(rows, columns, width, height):
    """A figure of rows × columns axes, each of this size in inches."""
    return plt.subplots(rows, columns, figsize=(width * columns, height * rows), squeeze=False)


def origin_of(result):
    machine = result["machine"]
    return (f"{result['commit']}, {machine['processor']}, {machine['processors']} processors, {result['date'][:10]}, "
            f"load at start {machine['load_average_at_start']:.1f}")


def save(figure, path, origin):
    figure.text(0.995, 0.005, origin, ha="right", va="bottom", fontsize=7, color="#666666")
    figure.tight_layout(rect=(0, 0.02, 1, 1))
    figure.savefig(path, metadata={"Date": None} if str(path).endswith(".svg") else None, dpi=110)
