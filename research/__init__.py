"""The paper, the literature and the written optimum: clients of the public interface of `vibro_ros`."""
