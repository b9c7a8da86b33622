"""Small MJCF files with the elements of well-known arms; numbers are made up.

Each has nested default classes, `childclass`, armature in a default, explicit inertials and meshes
whose files are not there.
"""

# ruff: noqa: E501  # lines of MJCF

UR5E = """<mujoco model="ur5e-like">
  <compiler angle="radian" meshdir="assets" autolimits="true"/>
  <option integrator="implicitfast"/>
  <default>
    <default class="ur">
      <material specular="0.5"/>
      <joint axis="0 1 0" range="-6.28319 6.28319" armature="0.1" damping="0.4" frictionloss="0.2"/>
      <general gaintype="fixed" biastype="affine" ctrlrange="-6.2831 6.2831" gainprm="2000"
        biasprm="0 -2000 -400" forcerange="-150 150"/>
      <default class="size1"><general gainprm="500" biasprm="0 -500 -100" forcerange="-28 28"/></default>
      <default class="limited"><joint range="-3.1415 3.1415"/></default>
      <default class="visual"><geom type="mesh" contype="0" conaffinity="0" group="2"/></default>
    </default>
  </default>
  <asset><material class="ur" name="black" rgba="0 0 0 1"/><mesh file="base_0.obj"/><mesh file="upper_0.obj"/></asset>
  <worldbody>
    <light pos="0 0 1"/>
    <body name="base" quat="0 0 0 -1" childclass="ur">
      <inertial mass="4" pos="0 0 0" diaginertia="0.0044 0.0044 0.0072"/>
      <geom mesh="base_0" material="black" class="visual"/>
      <body name="shoulder_link" pos="0 0 0.163">
        <inertial mass="3.7" pos="0 0 0.01" diaginertia="0.0102 0.0103 0.0067"/>
        <joint name="shoulder_pan_joint" axis="0 0 1"/>
        <body name="upper_arm_link" pos="0 0.138 0" quat="1 0 1 0">
          <inertial mass="8.393" pos="0.01 0 0.2125" quat="0.9 0.1 0.2 0.1" diaginertia="0.1339 0.1337 0.0151"/>
          <joint name="shoulder_lift_joint"/>
          <geom mesh="upper_0" material="black" class="visual"/>
          <body name="forearm_link" pos="0 -0.131 0.425">
            <inertial mass="2.275" pos="0 0.02 0.196" fullinertia="0.0312 0.0311 0.0041 0.0002 0.0003 -0.0001"/>
            <joint name="elbow_joint" class="limited"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <general class="ur" name="pan" joint="shoulder_pan_joint"/>
    <general class="ur" name="lift" joint="shoulder_lift_joint"/>
    <general class="size1" name="elbow" joint="elbow_joint"/>
  </actuator>
  <keyframe><key name="home" qpos="-1.57 -1.57 1.57" ctrl="-1.57 -1.57 1.57"/></keyframe>
</mujoco>"""

IIWA = """<mujoco model="iiwa-like">
  <compiler angle="degree" meshdir="assets"/>
  <default>
    <default class="iiwa">
      <joint axis="0 0 1" armature="0.4" damping="0.2"/>
      <position kp="2000" kv="200" inheritrange="1"/>
      <default class="joint1"><joint range="-170 170"/></default>
      <default class="joint2"><joint range="-120 120" damping="0.7"/></default>
    </default>
  </default>
  <asset><mesh name="link_1" file="link_1.obj" scale="0.001 0.001 0.001"/></asset>
  <worldbody>
    <body name="base" childclass="iiwa">
      <inertial mass="5" pos="-0.1 0 0.07" diaginertia="0.05 0.06 0.03"/>
      <body name="link1" pos="0 0 0.1575">
        <inertial mass="5.76" pos="0 -0.03 0.12" diaginertia="0.0333 0.033 0.0123"/>
        <joint name="joint1" class="joint1" ref="20"/>
        <geom type="mesh" mesh="link_1" contype="0" conaffinity="0"/>
        <body name="link2" pos="0 0 0.2025" euler="90 0 180">
          <inertial mass="6.35" pos="0.0003 0.059 0.042" diaginertia="0.0305 0.0304 0.011" quat="0.707107 0.707107 0 0"/>
          <joint name="joint2" class="joint2" pos="0.01 -0.02 0.03"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position class="joint1" name="actuator1" joint="joint1"/>
    <position class="joint2" name="actuator2" joint="joint2"/>
  </actuator>
</mujoco>"""

GEN3 = """<mujoco model="gen3-like">
  <compiler angle="radian"/>
  <default>
    <default class="large"><joint armature="0.3" damping="0.1"/><position kp="2000" kv="100" forcerange="-105 105"/></default>
    <default class="small"><joint armature="0.05"/><position kp="500" kv="50" forcerange="-52 52"/></default>
  </default>
  <worldbody>
    <body name="base_link">
      <body name="shoulder_link" pos="0 0 0.15643" quat="0 1 0 0" childclass="large">
        <inertial pos="-2.3e-5 -0.010364 -0.07336" quat="0.707051 0.0451246 -0.0453544 0.704263" mass="1.3773" diaginertia="0.00488868 0.00457 0.00135132"/>
        <joint name="joint_1" axis="0 0 1"/>
        <body name="half_arm_link" pos="0 0.005375 -0.12838" quat="1 1 0 0">
          <inertial pos="-4.4e-5 -0.09958 -0.013278" quat="0.482348 0.516286 -0.516862 0.483366" mass="1.1636" diaginertia="0.0113017 0.011088 0.00102532"/>
          <joint name="joint_2" axis="0 0 1" range="-2.24 2.24" limited="true"/>
          <body name="tool" pos="0 -0.3 0">
            <joint name="joint_3" class="small" axis="0 1 0"/>
            <joint name="joint_3b" class="small" axis="1 0 0" pos="0 0.05 0"/>
            <geom type="capsule" size="0.03 0.08" pos="0.02 0 0.05" mass="0.6"/>
            <site name="pinch_site" pos="0 0 0.1"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position class="large" name="joint_1" joint="joint_1"/><position class="large" name="joint_2" joint="joint_2"/>
  </actuator>
</mujoco>"""

XARM7 = """<mujoco model="xarm7-like">
  <compiler angle="radian" autolimits="true" meshdir="assets"/>
  <option integrator="implicitfast"/>
  <default>
    <default class="xarm7">
      <joint axis="0 0 1" armature="0.1" range="-6.28319 6.28319" frictionloss="1"/>
      <general biastype="affine"/>
      <default class="size1"><joint damping="10"/><general gainprm="1500" biasprm="0 -1500 -150" forcerange="-50 50"/></default>
      <default class="spring_link"><joint range="0 0.85" stiffness="0.05" springref="2.62" damping="0.00125" frictionloss="0"/></default>
      <default class="driver"><joint range="0 0.85" armature="0.005" damping="0.1" frictionloss="0"/></default>
    </default>
  </default>
  <worldbody>
    <body name="link_base" pos="0 0 .12" childclass="xarm7">
      <inertial pos="-0.021 -0.0002 0.05" quat="0.696843 0.20176 0.10388 0.680376" mass="0.88556" diaginertia="0.0038 0.0033 0.0024"/>
      <body name="link1" pos="0 0 0.267">
        <inertial pos="-0.0002 0.02869 -0.0134" quat="0.8 -0.3 0 0" mass="2.46" diaginertia="0.0053 0.005 0.0028"/>
        <joint name="joint1" class="size1"/>
        <body name="link2" quat="1 -1 0 0">
          <inertial pos="0.001 -0.159 0.01" quat="0.9 0.1 0.1 0.2" mass="1.916" diaginertia="0.0053 0.005 0.0028"/>
          <joint name="joint2" class="size1" range="-2.059 2.0944"/>
          <body name="xarm_gripper_base_link" pos="0 -0.3 0.05">
            <inertial mass="0.54" pos="0 0 0.05" diaginertia="0.0006 0.0005 0.0003"/>
            <body name="left_outer_knuckle" pos="0 0.035 0.06">
              <inertial mass="0.03" pos="0 0.02 0.02" diaginertia="2e-5 2e-5 3e-6"/>
              <joint name="left_driver_joint" axis="1 0 0" class="driver"/>
              <body name="left_finger" pos="0 0.035 0.042">
                <inertial mass="0.04" pos="0 -0.01 0.02" diaginertia="2e-5 2e-5 6e-6"/>
                <joint name="left_finger_joint" axis="-1 0 0" class="driver"/>
              </body>
            </body>
            <body name="left_inner_knuckle" pos="0 0.02 0.074">
              <inertial mass="0.03" pos="0 0.02 0.02" diaginertia="2e-5 2e-5 3e-6"/>
              <joint name="left_inner_knuckle_joint" axis="1 0 0" class="spring_link"/>
            </body>
            <body name="right_outer_knuckle" pos="0 -0.035 0.06">
              <inertial mass="0.03" pos="0 -0.02 0.02" diaginertia="2e-5 2e-5 3e-6"/>
              <joint name="right_driver_joint" axis="-1 0 0" class="driver"/>
            </body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <contact><exclude body1="link1" body2="link2"/></contact>
  <tendon><fixed name="split"><joint joint="right_driver_joint" coef="0.5"/><joint joint="left_driver_joint" coef="0.5"/></fixed></tendon>
  <equality>
    <connect anchor="0 0.015 0.015" body1="left_finger" body2="left_inner_knuckle"/>
    <joint joint1="left_driver_joint" joint2="right_driver_joint" polycoef="0 1 0 0 0"/>
  </equality>
  <actuator>
    <general class="size1" name="act1" joint="joint1"/><general class="size1" name="act2" joint="joint2"/>
    <general class="xarm7" name="gripper" tendon="split" forcerange="-50 50" ctrlrange="0 255" gainprm="0.333" biasprm="0 -100 -10"/>
  </actuator>
  <keyframe><key name="home" qpos="0 -.247 0 0 0 0" ctrl="0 -.247 0"/></keyframe>
</mujoco>"""

# Text, joints that are identified, joints that are locked.
ARMS = {
    "ur5e": (UR5E, ("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint"), ()),
    "iiwa14": (IIWA, ("joint1", "joint2"), ()),
    "gen3": (GEN3, ("joint_1", "joint_2", "joint_3", "joint_3b"), ()),
    "xarm7": (XARM7, ("joint1", "joint2"), ("left_driver_joint", "left_finger_joint",
              "left_inner_knuckle_joint", "right_driver_joint")),
}  # fmt: skip
