"""Research studies that use the public interface of `vibro_ros`: the paper, other publications, and the optimum."""
